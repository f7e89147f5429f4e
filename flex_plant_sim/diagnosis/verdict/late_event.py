"""An event in the locked part: what no fit saw is asked whether it is like the rest."""

from __future__ import annotations

from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses, CauseSet
from flex_plant_sim.diagnosis.causes.search import SearchResult
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.prior import log_prior_odds
from flex_plant_sim.diagnosis.likelihood.sufficient_statistics import TEMPER
from flex_plant_sim.diagnosis.record.data import Data
import numpy as np


def has_event(fit: Fit) -> bool:
    """Tell whether a cause of a set happens at a time."""
    return any(h.event_index is not None for h in fit.hypotheses)


def locked_part_differs(found: SearchResult, data: Data) -> bool:
    """
    Tell whether the locked part fits so much worse that an event there is likelier than none.

    With the causes and parts of the best set, errors of variance s^2 where all was fitted and
    r s^2 in the n samples of the locked part, a variance of its own is n (r - 1 - ln r) / 2T nats
    likelier, T the temper, summed over channels. That has to pay for the event.
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
    fitted = best.likelihood.whitened_residual(effects, parts)[0]
    left = locked.whitened_residual(effects, parts)[0]
    ratio = np.maximum(np.mean(left**2, axis=1) / np.mean(fitted**2, axis=1), 1.0)
    nats = left.shape[1] / (2.0 * TEMPER) * np.sum(ratio - 1.0 - np.log(ratio))
    return bool(nats > price)
