"""
Sets with a cause that is a factor on a part, in place of a large deviation of that part.

The search derives them from a refined fit, without a pass through the record.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.gauss_newton import GaussNewton, LinearisationPoint
from flex_plant_sim.diagnosis.causes.hypothesis import CauseSet, Hypothesis
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.likelihood.prior import factors_on_parts, log_prior_odds
import numpy as np


def fits_replacing_parts(centre: RefinedFit, catalogue: Sequence[Hypothesis]) -> Iterator[Fit]:
    """
    Return fits with one more cause that is a factor on a part, where that is more probable.

    Cause and part are one coordinate of the arm, of which a record knows the product alone; only
    their priors, with variances w^2 and t^2, differ. The cause takes the share
    w^2 / (w^2 + t^2) of the part's deviation d. It gains half of (that share of d^2 / t^2, less
    ln(1 + w^2 / t^2)), nats, and pays its prior odds. The part's column of the centre's Jacobian
    serves the cause too.
    """
    fit, likelihood = centre.fit, centre.likelihood
    factors = factors_on_parts(likelihood.base.robot)
    names, labels = [p.name for p in likelihood.parts], {h.label for h in fit.hypotheses}
    for h in catalogue:
        if h.label not in factors or h.label in labels:
            continue
        part, power = factors[h.label]
        index = names.index(part.name)
        variance_ratio = (h.parameters[0].typical / part.tolerance)**2
        share, deviation = variance_ratio / (1.0 + variance_ratio), float(fit.deviations[index])
        gain = 0.5 * (share * (deviation / part.tolerance)**2 - np.log1p(variance_ratio))
        if gain + log_prior_odds(h.effect, likelihood.base.robot) < 0.0:
            continue
        value = np.clip(h.null * np.exp(power * share * deviation), h.low, h.high)
        # The deviation that the cause takes, after clipping.
        taken, derivative = np.log(value / h.null).item() / power, likelihood.part_jacobian[index]
        point = LinearisationPoint(
            np.r_[fit.values, value], centre.point.residual + taken * derivative,
            np.concatenate([centre.point.jacobian, derivative[None] / (power * value)]),
            centre.point.cost)
        causes = CauseSet((*fit.hypotheses, h), likelihood.duration)
        yield GaussNewton(likelihood, causes, fit.error_scale).fit(point)
