"""Sets in which a cause that is a factor on a part does what the part, far off, does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from flex_plant_sim.diagnosis.causes.fit import Fit, GaussNewton, LinearisationPoint
from flex_plant_sim.diagnosis.causes.hypothesis import CauseSet, Hypothesis
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.likelihood.prior import factors_on_parts, log_prior_odds
import numpy as np


def fits_replacing_parts(centre: RefinedFit, catalogue: Sequence[Hypothesis]) -> Iterator[Fit]:
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
        if gain + log_prior_odds(h.effect, likelihood.base.robot) < 0.0:
            continue
        value = np.clip(h.null * np.exp(power * share * deviation), h.low, h.high)
        removed, column = np.log(value / h.null).item() / power, likelihood.part_jacobian[place]
        causes = CauseSet((*fit.hypotheses, h), likelihood.duration)
        point = LinearisationPoint(np.r_[fit.values, value], centre.point.residual + removed * column,
                      np.concatenate([centre.point.jacobian, column[None] / (power * value)]),
                      centre.point.cost)
        yield GaussNewton(likelihood, causes, fit.error_scale).fit(point)
