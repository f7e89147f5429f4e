"""The search for sets of causes: add, exchange, drop until the evidence stops rising."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.fit import Causes, Fit, fitted
from flex_plant_sim.diagnosis.causes.hypothesis import hypotheses, Hypothesis
from flex_plant_sim.diagnosis.causes.pool import attempt, each
from flex_plant_sim.diagnosis.causes.posterior import Posterior
from flex_plant_sim.diagnosis.causes.promise import Context, Promise
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.prediction.discrepancy import Amplitude
from flex_plant_sim.diagnosis.prediction.predictor import Base
from flex_plant_sim.diagnosis.record.data import Data
import numpy as np

Level = Amplitude
Progress = Callable[[str, float], None]

# What `unknown` is: slow torques, gauge errors or both of 20 % of the loads and the strains.
UNKNOWN_LEVELS: tuple[Level, ...] = (
    Amplitude(torque=0.2), Amplitude(gauge=0.2), Amplitude(torque=0.2, gauge=0.2))
# A budget, no judgement: rounds, hypotheses fitted a round, rivals tried in each one's place,
# samples that promises are read from.
ROUNDS, FITTED, RIVALS, SAMPLES = 6, 6, 2, 1500
# Parts further than this from where they were linearised, in tolerances, and scales that moved
# by more, relative, are linearised anew, so many times.
FAR, RESCALED, RELINEARISED, NEAR = 1.0, 0.05, 2, 0.0


@dataclass(frozen=True)
class Trial:
    """A set of causes to settle, and where to start."""

    hypotheses: tuple[Hypothesis, ...]
    values: Array
    deviations: Array | None = None
    scale: Array | None = None

    @classmethod
    def of(cls, fit: Fit) -> Trial:
        """Return a fit as a trial."""
        return cls(fit.hypotheses, fit.values, fit.deviations, fit.scale)

    @property
    def labels(self) -> frozenset[str]:
        """Return the labels of the causes."""
        return frozenset(h.label for h in self.hypotheses)

    def pieces(self) -> list[tuple[Hypothesis, Array]]:
        """Return each cause with its values."""
        return list(zip(self.hypotheses, Causes(self.hypotheses, 1.0).split(self.values)))

    def with_pieces(self, pieces: Sequence[tuple[Hypothesis, Array]]) -> Trial:
        """Return another set, its parts where these are."""
        values = np.concatenate([np.zeros(0), *(v for _, v in pieces)])
        return replace(self, hypotheses=tuple(h for h, _ in pieces), values=values)

    def neighbours(self, rivals: Sequence[tuple[Hypothesis, Array]]) -> list[Trial]:
        """Return the sets with one cause less, and with one exchanged for a rival."""
        pieces, found = self.pieces(), []
        others = [rival for rival in rivals if rival[0].label not in self.labels]
        for k in range(len(pieces)):
            rest = pieces[:k] + pieces[k + 1:]
            found += [self.with_pieces(rest),
                      *(self.with_pieces([*rest, rival]) for rival in others)]
        return found


@dataclass(frozen=True)
class Settled:
    """A set with the likelihood linearised around it, and its fit there."""

    likelihood: Likelihood
    fit: Fit


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
    posterior : Posterior
        Over the best set and all its neighbours, and `unknown`.
    nothing : Fit
        The nominal model with its parts re-estimated.
    sizes : tuple of int
        Of the best set after each round.

    """

    best: Settled
    promises: tuple[Promise, ...]
    posterior: Posterior
    nothing: Fit
    sizes: tuple[int, ...]


class _Course:
    """What all steps of a search share."""

    def __init__(self, data: Data, nominal: Base, jobs: int, exclude: Sequence[str],
                 progress: Progress):
        self.data, self.nominal, self.jobs, self.progress = data, nominal, jobs, progress
        self.catalogue = [h for h in hypotheses(nominal.robot, exclude)
                          if not any(h.effect is type(e) for e in nominal.effects)]
        self.rivals: dict[str, tuple[Hypothesis, Array]] = {}

    def settle(self, trial: Trial, level: Level) -> Settled | None:
        """Return a set fitted around itself, its parts linearised where they are, if it can be."""
        found = None
        for _ in range(RELINEARISED):
            again = attempt(partial(self.around, level=level), trial)
            if again is None:
                break
            found, before = again, again.likelihood
            moved = (found.fit.deviations - before.deviations) / before.tolerances
            rescaled = np.log(found.fit.scale / before.scale)
            # Where the right causes are on, parts are near their file: no further out than that
            # is it worth knowing them exactly.
            near = np.clip(found.fit.deviations, -NEAR * before.tolerances,
                           NEAR * before.tolerances)
            trial = replace(Trial.of(found.fit), deviations=near)
            if np.max(np.abs(moved)) < FAR and np.max(np.abs(rescaled)) < RESCALED:
                break
        return found

    def around(self, trial: Trial, level: Level) -> Settled:
        """Return a set fitted around a trial of it."""
        causes = Causes(trial.hypotheses, self.data.duration)
        likelihood = Likelihood(
            replace(self.nominal, discrepancy=level), self.data.windows, self.data.noise,
            causes.effects(trial.values), trial.deviations, trial.scale)
        return Settled(likelihood, fitted(likelihood, causes, (trial.values,)))

    def level_best(self, trial: Trial, levels: Sequence[Level]) -> tuple[Settled, list[Fit]]:
        """
        Return a set at its most probable level, and its fits at all of them.

        Raises
        ------
        LinAlgError
            Where it makes no finite prediction at any.

        """
        settled: list[Settled | None] = [self.settle(trial, levels[0])]
        # Errors no larger than the known discrepancy leave nothing for a larger one to explain.
        if settled[0] is None or np.any(settled[0].fit.scale > 1.0):
            settled += [self.settle(trial, level) for level in levels[1:]]
        found = [s for s in settled if s is not None]
        if not found:
            raise np.linalg.LinAlgError('no finite prediction')
        fits = [s.fit for s in found]
        best = Posterior.of(fits, self.nominal).best
        return next(s for s in found if s.fit is best), fits

    def added(self, centre: Settled) -> tuple[list[Promise], list[Fit]]:
        """Return what all hypotheses promise beside a set, and the best of them fitted."""
        fit = centre.fit
        known = Trial.of(fit).labels
        told = partial(self.progress, f'cause {len(known) + 1}')
        context = Context(centre.likelihood.thinned(SAMPLES), fit, self.data.duration)
        trial = [h for h in self.catalogue if h.label not in known]
        promises = each(context, trial, self.jobs, lambda share: told(0.6 * share))
        promises.sort(key=lambda p: -p.gain)
        task = _Grown(centre, self.data.duration)
        found = each(task, promises[:FITTED], self.jobs, lambda s: told(0.6 + 0.4 * s))
        for near in Posterior.of(found, self.nominal).fits[:1 + RIVALS]:
            last = Trial.of(near).pieces()[-1]
            self.rivals[last[0].label] = last
        return promises, found

    def neighbours(self, centre: Settled) -> list[Fit]:
        """Return the sets with one cause less or exchanged, fitted around a set."""
        trials = Trial.of(centre.fit).neighbours(list(self.rivals.values()))
        fresh = list({t.labels: t for t in trials}.values())
        return each(_Near(centre, self.data.duration), fresh, self.jobs)


@dataclass(frozen=True)
class _Grown:
    """Fits a set with one more cause around the set's own linearisation."""

    centre: Settled
    duration: float

    def __call__(self, promise: Promise) -> Fit:
        fit = self.centre.fit
        causes = Causes((*fit.hypotheses, promise.hypothesis), self.duration)
        starts = [np.concatenate([fit.values, start]) for start in promise.starts]
        return fitted(self.centre.likelihood, causes, starts)


@dataclass(frozen=True)
class _Near:
    """Fits a set around the linearisation of one near it."""

    centre: Settled
    duration: float

    def __call__(self, trial: Trial) -> Fit:
        causes = Causes(trial.hypotheses, self.duration)
        return fitted(self.centre.likelihood, causes, (trial.values,))


def search(data: Data, nominal: Base, jobs: int, progress: Progress,
           exclude: Sequence[str] = ()) -> Search:
    """
    Return where a search among sets of causes ends.

    It runs in `jobs` processes, tells `progress` a step's name and its share done, and leaves the
    identifiers in `exclude` out of the catalogue.
    """
    course = _Course(data, nominal, jobs, exclude, progress)
    progress('nothing, and unknown', 0.0)
    levels = (nominal.discrepancy, *UNKNOWN_LEVELS)
    centre, at_levels = course.level_best(Trial((), np.zeros(0)), levels)
    nothing, sizes = at_levels[0], []
    ends: dict[frozenset[str], Search] = {}
    while True:
        promises, found = course.added(centre)
        near = [*found, *course.neighbours(centre)]
        posterior = Posterior.of([centre.fit, *near], nominal, at_levels)
        sizes.append(len(posterior.best.hypotheses))
        trial = Trial.of(posterior.best)
        ends[Trial.of(centre.fit).labels] = Search(
            centre, tuple(promises), posterior, nothing, tuple(sizes))
        if trial.labels in ends or len(sizes) > ROUNDS:
            return ends[Trial.of(Posterior.of(
                [end.best.fit for end in ends.values()], nominal).best).labels]
        # A further cause asks for no larger discrepancy than there was.
        levels = tuple(level for level in levels
                       if level.torque <= centre.fit.discrepancy.torque
                       and level.gauge <= centre.fit.discrepancy.gauge)
        centre, at_levels = course.level_best(trial, levels)
