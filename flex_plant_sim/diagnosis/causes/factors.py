"""Sets in which a cause that is a factor on a part does what the part, far off, does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from flex_plant_sim.diagnosis.causes.hypothesis import Hypothesis
from flex_plant_sim.diagnosis.causes.sets import Settled, Trial
from flex_plant_sim.diagnosis.likelihood.prior import factors_on_parts, log_odds
import numpy as np


def in_place_of_parts(centre: Settled, catalogue: Sequence[Hypothesis]) -> Iterator[Trial]:
    """
    Return sets with one cause more that is a factor on a part, where it is likelier than that.

    Both are one coordinate of the arm: the record knows their product alone. What parts them is
    the prior, of variances w^2 and t^2: the cause has w^2 / (w^2 + t^2) of the part's deviation d
    and gains half of that share of d^2 / t^2 less ln(1 + w^2 / t^2), nats, and its price.
    """
    fit, robot = centre.fit, centre.likelihood.base.robot
    factors, names = factors_on_parts(robot), [part.name for part in centre.likelihood.parts]
    now = Trial.of(fit)
    for h in catalogue:
        if h.label not in factors or h.label in now.labels:
            continue
        part, power = factors[h.label]
        place, wider = names.index(part.name), (h.parameters[0].typical / part.tolerance)**2
        share, deviations = wider / (1.0 + wider), fit.deviations.copy()
        gain = 0.5 * (share * (deviations[place] / part.tolerance)**2 - np.log1p(wider))
        if gain + log_odds(h.effect, robot) < 0.0:
            continue
        start = h.null * np.exp(power * share * deviations[place])
        deviations[place] *= 1.0 - share
        yield Trial((*now.hypotheses, h), (np.concatenate([
            fit.values, np.clip(start, h.low, h.high)]),), deviations)
