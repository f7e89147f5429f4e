"""The search for sets of causes: add, exchange, drop until the evidence stops rising."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from flex_plant_sim.diagnosis.causes.course import Course, Progress
from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.looks import Looker
from flex_plant_sim.diagnosis.causes.posterior import judged, Key, lacking, ORDINARY, Posterior
from flex_plant_sim.diagnosis.causes.promise import Closer, Promise
from flex_plant_sim.diagnosis.causes.sets import Settled, Trial
from flex_plant_sim.diagnosis.prediction.predictor import Base
from flex_plant_sim.diagnosis.record.data import Data
import numpy as np

# A budget, no judgement: sets whose neighbours are fitted.
EXPLORED = 5


@dataclass(frozen=True)
class Search:
    """
    Where a search ended.

    Attributes
    ----------
    best : Settled
        The most probable set.
    promises : tuple of Promise
        What each further hypothesis promised beside it.
    closer : Closer
        Looks at any of them again.
    posterior : Posterior
        Over all sets that were fitted.
    nothing : Fit
        The nominal model with its parts re-estimated.
    sizes : tuple of int
        Of the set that each round started from.

    """

    best: Settled
    promises: tuple[Promise, ...]
    closer: Closer
    posterior: Posterior
    nothing: Fit
    sizes: tuple[int, ...]


def search(data: Data, nominal: Base, jobs: int, progress: Progress,
           exclude: Sequence[str] = ()) -> Search:
    """
    Return where a search among sets of causes ends.

    Where gauges err by more than every model may, what is unmodelled is no small part of the
    strain, and a hypothesis's sensors see it like the rest: then it is searched again so, and as
    soon as no set of as many causes as are ordinary does without.

    Parameters
    ----------
    data : Data
        The records.
    nominal : Base
        The model in question.
    jobs : int
        Processes.
    progress : Callable
        Told a step's name and its share done.
    exclude : sequence of str
        Identifiers to leave out of the catalogue.

    """
    course = Course(data, nominal, jobs, exclude, progress)
    while (found := _searched(course)) is None:
        course = course.sensed()
    return found


def _searched(course: Course) -> Search | None:
    """
    Return where one search ends; None where it is to begin anew, see `search`.

    The most probable set is linearised around itself and its neighbours are fitted, until the
    most probable set is one whose neighbours are known.
    """
    nominal, progress = course.nominal, course.progress
    progress('nothing', 0.0)
    nothing = course.settle(Trial((), (np.zeros(0),), course.about), nominal.discrepancy)
    best = nothing.near_file(nominal, course.data, course.jobs)
    if not course.looks:
        course.look(best)
    promises = {Key.of(nothing.fit): course.around(best)}
    while len(promises) < EXPLORED:
        course.settle_leading(best)
        course.try_laws(best)
        # What was fitted around another set and turns out worse around itself has fallen back.
        best = course.best
        if Key.of(best.fit) in promises:
            course.settle_rivals(best, nothing)
            best = course.best
        if Key.of(best.fit) in promises:
            progress('unknown', 0.9)
            course.try_far_parts()
            course.settle_leading(best)
            best = course.best
        if Key.of(best.fit) in promises:
            break
        likeliest = max(judged(best.fit), key=course.score)
        if len(best.fit.hypotheses) >= ORDINARY and lacking(likeliest):
            return None
        promises[Key.of(best.fit)] = course.around(best)
    else:
        course.try_far_parts()
        course.settle_leading(best)
    last = max((course.settled[key] for key in promises), key=lambda c: course.score(c.fit))
    beside = promises[Key.of(last.fit)]
    posterior = course.ranked(last, beside)
    if lacking(posterior.best):
        return None
    best = course.settled.get(Key.of(posterior.best).plain, last)
    closer = Closer(Looker(course.thin, course.data.duration), course.beside(last))
    return Search(replace(best, fit=posterior.best), tuple(beside), closer, posterior, nothing.fit,
                  tuple(len(key.labels) for key in promises))
