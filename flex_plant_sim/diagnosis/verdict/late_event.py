"""An event in the locked part: what no fit saw is asked whether it is like the rest."""

from __future__ import annotations

from collections.abc import Sequence

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses, CauseSet
from flex_plant_sim.diagnosis.causes.neighbours import fit_neighbours
from flex_plant_sim.diagnosis.causes.proposal_step import probe_catalogue
from flex_plant_sim.diagnosis.causes.refinement import refine_leading
from flex_plant_sim.diagnosis.causes.search import search, SearchResult
from flex_plant_sim.diagnosis.causes.search_state import Progress, SearchState
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.prior import log_prior_odds
from flex_plant_sim.diagnosis.likelihood.sufficient_statistics import TEMPER
from flex_plant_sim.diagnosis.pool import attempt
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.record.data import Data
import numpy as np


def has_event(fit: Fit) -> bool:
    """Tell whether a cause of a set happens at a time."""
    return any(h.event_index is not None for h in fit.hypotheses)


def tells_more(again: SearchResult, found: SearchResult) -> bool:
    """
    Tell whether a search that saw the part that differed answers for the record.

    It does where it finds an event, and where it finds anything while the first one found nothing.
    """
    nothing = found.posterior.nothing_probability > 0.5 > again.posterior.nothing_probability
    return nothing or has_event(again.best.fit)


def searched_again(found: SearchResult, seen: Data, other: Data, nominal: BaseModel, jobs: int,
                   progress: Progress, exclude: Sequence[str]) -> tuple[SearchResult, Data]:
    """
    Return the search that answers for a record whose locked part differs, and what that saw.

    Parameters
    ----------
    found, seen : SearchResult, Data
        What was found, and where.
    other : Data
        With what differs among the windows that are fitted.
    nominal, jobs, progress, exclude
        See `search`.

    """
    def told(step: str, share: float) -> None:
        progress(f'again: {step}', share)

    if event_pays(found, other, nominal, jobs, told, exclude):
        again = search(other, nominal, jobs, told, exclude)
        if tells_more(again, found):
            return again, other
    return found, seen


def locked_part_differs(found: SearchResult, data: Data) -> bool:
    """
    Tell whether the locked part fits so much worse that an event there is likelier than none.

    With the causes and parts of the best set; see `log_odds_of_larger`. It has to pay for the
    event, and for the channel and the window in which it shows most.
    """
    best = found.best
    robot = best.likelihood.base.robot
    price = min((-log_prior_odds(h.effect, robot) for h in all_hypotheses(robot)
                 if h.event_index is not None), default=np.inf)
    if has_event(best.fit):
        return False
    effects = CauseSet(best.fit.hypotheses, data.duration).effects(best.fit.values)
    parts = best.fit.deviations
    locked = Likelihood(best.likelihood.base, data.locked, data.noise, effects, parts)
    length = data.windows[0].length
    # Of all channels, windows and samples.
    shape = len(robot.output_names), -1, length
    before, after = (
        np.mean(likelihood.whitened_residual(effects, parts)[0].reshape(shape)**2, axis=2)
        for likelihood in (best.likelihood, locked))
    nats = log_odds_of_larger(np.log(before), np.log(after), 2.0 * TEMPER / length)
    return bool(np.max(nats) - np.log(nats.size) > price)


def event_pays(found: SearchResult, other: Data, nominal: BaseModel, jobs: int,
               progress: Progress, exclude: Sequence[str]) -> bool:
    """
    Tell whether an event beside the causes found, or in the place of one, is likelier than none.

    Where something was found, only an event changes the answer, see `tells_more`; so it is asked
    for before all causes are searched for again. The parameters are those of `searched_again`.
    """
    if found.posterior.nothing_probability > 0.5:
        return True
    state, fit = SearchState(other, nominal, jobs, exclude, progress), found.best.fit
    state.catalogue = [h for h in state.catalogue if h.event_index is not None]
    best = attempt(lambda candidate: state.refine(candidate, fit.discrepancy, fit.error_scale),
                   CandidateSet.of(fit))
    if best is None:
        return True
    probe_catalogue(state, best)
    fit_neighbours(state, best)
    refine_leading(state, best)
    return has_event(state.best.fit)


def log_odds_of_larger(before: Array, after: Array, chance: float) -> Array:
    """
    Return by how much a mean of its own explains each later value better, nats, (m, L).

    Values are Gaussian with one unknown variance, estimated from the earlier ones of all channels:
    nats are those of Student's t with m (W - 1) degrees of freedom. Zero where a later one is
    smaller.

    Parameters
    ----------
    before, after : Array
        Log-power of the errors in W earlier and in later windows, (m, W) and (m, L).
    chance : float
        Least variance: that of the log-power of a window of Gaussian errors.

    """
    count = before.shape[1]
    free = before.size - len(before)
    variance = max(float(np.mean(np.var(before, axis=1, ddof=1))), chance) * (1.0 + 1.0 / count)
    step = np.maximum(after - before.mean(axis=1)[:, None], 0.0)
    return np.asarray(0.5 * (free + 1) * np.log1p(step**2 / variance / free))
