"""Values and parts fitted together: no part is taken for linear."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.fit import Causes, Descent, ITERATIONS, Point
from flex_plant_sim.diagnosis.likelihood.evidence import channel_products, Slab
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.moments import Moments
import numpy as np


class Whole(Descent):
    """
    The same descent over the values and the parts' deviations side by side, (k + p,).

    A tolerance may be a third or more: there parts are not linear.

    Parameters
    ----------
    likelihood : Likelihood
        Its linearisation is where the descent begins.
    causes : Causes

    """

    def __init__(self, likelihood: Likelihood, causes: Causes):
        super().__init__(likelihood, causes)
        own, none = causes.slab, np.zeros(self.tolerances.size)
        self.slab = Slab(np.r_[own.centre, none], np.r_[own.width, self.tolerances],
                         np.r_[own.sided, none], np.r_[own.spiked, none])

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Return the bounds of the values; deviations have none."""
        free = np.full(self.tolerances.size, np.inf)
        low, high = self.causes.bounds
        return np.r_[low, -free], np.r_[high, free]

    def split(self, both: Array) -> tuple[Array, Array]:
        """Return values (k,) and deviations (p,)."""
        k = both.size - self.tolerances.size
        return both[:k], both[k:]

    def residual(self, values: Array) -> Array:
        """Return the errors at values and deviations, (m, N)."""
        values, parts = self.split(values)
        near = self.likelihood.near(parts)
        errors = self.likelihood.errors(self.causes.effects(values), near)[0]
        return np.asarray(errors + np.tensordot(parts - near, self.likelihood.columns, 1))

    def down(self, point: Point, parts: Array) -> tuple[Point, int, float]:
        """Return the minimum from values and parts, (p,), the steps to it, what they gain."""
        both = np.concatenate([point.values, parts])
        residual = point.residual + np.tensordot(parts, self.likelihood.columns, 1)
        first = now = Point(both, residual, np.concatenate([
            point.columns, self.likelihood.columns]), *self.costs(both, residual))
        for steps in range(ITERATIONS):
            better = self.lower(now)
            if better is None:
                return now, steps, first.cost - now.cost
            now = better
        return now, ITERATIONS, first.cost - now.cost

    def along(self, found: Point) -> Point:
        """Return a point as one of the values, the parts linear from there on."""
        values, parts = self.split(found.values)
        moved = np.tensordot(parts, self.likelihood.columns, 1)
        return Point(values, found.residual - moved, found.columns[:values.size], found.scale,
                     found.cost)

    def _moments(self, own: Array, away: Array, slab: Slab) -> Moments:
        return Moments(channel_products(own, own), away, slab, np.zeros(0),
                       self.likelihood.weight * own.shape[-1], self.likelihood.surprise)
