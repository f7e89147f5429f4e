"""
Sets with a cause that does the same as a part, in place of a large deviation of that part.

The search derives them from a refined fit, without a pass through the record.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.gauss_newton import GaussNewton, LinearisationPoint
from flex_plant_sim.diagnosis.causes.hypothesis import CauseSet, Hypothesis
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.prior import factors_on_parts, log_prior_odds
import numpy as np


@dataclass(frozen=True)
class _SharedCoordinate:
    """
    A part whose deviation d does the same as a cause of size null exp(p d), or null + s d.

    Attributes
    ----------
    index : int
        Of the part.
    factor : bool
        Whether the cause is a factor on the part.
    slope : float
        p, or s.

    """

    index: int
    factor: bool
    slope: float

    def size(self, null: float, deviation: float) -> float:
        """Return the size that does the same as a deviation."""
        return float(null * np.exp(self.slope * deviation) if self.factor
                     else null + self.slope * deviation)

    def deviation(self, null: float, size: float) -> float:
        """Return the deviation that does the same as a size."""
        return float((np.log(size / null) if self.factor else size - null) / self.slope)

    def size_slope(self, size: float) -> float:
        """Return the derivative of the size in the deviation."""
        return self.slope * size if self.factor else self.slope


def fits_replacing_parts(centre: RefinedFit, catalogue: Sequence[Hypothesis]) -> Iterator[Fit]:
    """
    Return fits with one more cause in place of a part's deviation, where that is more probable.

    Cause and part are one coordinate of the arm, of which a record knows the sum alone; only
    their priors, with variances w^2 and t^2, differ. The cause takes the share
    w^2 / (w^2 + t^2) of the part's deviation d. It gains half of (that share of d^2 / t^2, less
    ln(1 + w^2 / t^2)), nats, and pays its prior odds. The part's column of the centre's Jacobian
    serves the cause too; further parameters of the cause stay at their null.
    """
    fit, likelihood = centre.fit, centre.likelihood
    shared, labels = _shared_coordinates(likelihood), {h.label for h in fit.hypotheses}
    for h in catalogue:
        if h.label not in shared or h.label in labels:
            continue
        same, first = shared[h.label], h.parameters[0]
        tolerance = likelihood.parts[same.index].tolerance
        variance_ratio = (first.typical / same.size_slope(first.null) / tolerance)**2
        share, deviation = variance_ratio / (1.0 + variance_ratio), fit.deviations[same.index]
        gain = 0.5 * (share * (deviation / tolerance)**2 - np.log1p(variance_ratio))
        if gain + log_prior_odds(h.effect, likelihood.base.robot) < 0.0:
            continue
        size = float(np.clip(same.size(first.null, share * deviation), first.low, first.high))
        yield _with_cause(centre, h, same, size)


def _with_cause(centre: RefinedFit, h: Hypothesis, same: _SharedCoordinate, size: float) -> Fit:
    """Return the fit with a cause of a size, from which a part's deviation is taken."""
    fit, likelihood, derivative = centre.fit, centre.likelihood, centre.likelihood.part_jacobian
    change: Array = derivative[same.index]
    columns = np.zeros((len(h.parameters), *change.shape))
    columns[0] = change / same.size_slope(size)
    point = LinearisationPoint(
        np.r_[fit.values, size, [p.null for p in h.parameters[1:]]],
        centre.point.residual + same.deviation(h.parameters[0].null, size) * change,
        np.concatenate([centre.point.jacobian, columns]), centre.point.cost)
    causes = CauseSet((*fit.hypotheses, h), likelihood.duration)
    return GaussNewton(likelihood, causes, fit.error_scale).fit(point)


def _shared_coordinates(likelihood: Likelihood) -> dict[str, _SharedCoordinate]:
    """Return the causes that do the same as a part: their label to the coordinate."""
    index = {part.name: k for k, part in enumerate(likelihood.parts)}
    found = {label: _SharedCoordinate(index[same.part.name], True, same.power)
             for label, same in factors_on_parts(likelihood.base.robot).items()
             if same.part.name in index}
    for part in likelihood.parts:
        if part.effect is not None:
            null, one = (part.effect(d).values[0] for d in (0.0, 1.0))
            found[part.name] = _SharedCoordinate(index[part.name], False, one - null)
    return found
