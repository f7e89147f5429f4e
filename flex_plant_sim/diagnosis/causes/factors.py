"""Sets in which a cause that is a factor on a part does what the part, far off, does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from flex_plant_sim.diagnosis.causes.fit import Descent, Fit, Point
from flex_plant_sim.diagnosis.causes.hypothesis import Causes, Hypothesis
from flex_plant_sim.diagnosis.causes.sets import Settled
from flex_plant_sim.diagnosis.likelihood.prior import factors_on_parts, log_odds
import numpy as np


def in_place_of_parts(centre: Settled, catalogue: Sequence[Hypothesis]) -> Iterator[Fit]:
    """
    Return sets with one cause more that is a factor on a part, where it is likelier than that.

    Both are one coordinate of the arm: the record knows their product alone. What parts them is
    the prior, of variances w^2 and t^2: the cause has w^2 / (w^2 + t^2) of the part's deviation d
    and gains half of that share of d^2 / t^2 less ln(1 + w^2 / t^2), nats, and its price. So the
    centre's own columns tell such a set, as linear as they are; that costs no pass.
    """
    fit, likelihood = centre.fit, centre.likelihood
    factors = factors_on_parts(likelihood.base.robot)
    names, labels = [p.name for p in likelihood.parts], {h.label for h in fit.hypotheses}
    for h in catalogue:
        if h.label not in factors or h.label in labels:
            continue
        part, power = factors[h.label]
        place, wider = names.index(part.name), (h.parameters[0].typical / part.tolerance)**2
        share, deviation = wider / (1.0 + wider), float(fit.deviations[place])
        gain = 0.5 * (share * (deviation / part.tolerance)**2 - np.log1p(wider))
        if gain + log_odds(h.effect, likelihood.base.robot) < 0.0:
            continue
        value = np.clip(h.null * np.exp(power * share * deviation), h.low, h.high)
        taken, column = np.log(value / h.null).item() / power, likelihood.columns[place]
        causes = Causes((*fit.hypotheses, h), likelihood.duration)
        point = Point(np.r_[fit.values, value], centre.point.residual + taken * column,
                      np.concatenate([centre.point.columns, column[None] / (power * value)]),
                      centre.point.cost)
        yield Descent(likelihood, causes, fit.scale).fit(point)
