"""A fitted set of causes as the products of its residual and columns: evidence at any scale."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from itertools import combinations
import math

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.likelihood.evidence import Marginal, Slab
import numpy as np

# So many samples count as one: then the parts of clean arms, which are known, are as far off as
# stated where that is worst, and likeliest on all (benchmarks/temper.py, docs/evidence.md).
TEMPER = 16.0
# Of a scale, which is likeliest: the evidence is off by twice its square for each sample that
# counts, 1e-3 nats; and rounds at most.
SETTLED, ROUNDS = 1e-3, 20


@dataclass(frozen=True)
class Moments:
    """
    Products of [residual, columns of the values, columns of the parts], per channel.

    Attributes
    ----------
    products : Array
        (m, 1 + k + p, 1 + k + p).
    away : Array
        Values less the centres of their slabs, (k,).
    slab : Slab
        Of the values.
    tolerances : Array
        Of the parts, (p,).
    samples : float
        Of each channel.
    surprise : Array
        Minus the log-likelihood that whitening alone costs each channel, nats, (m,).

    """

    products: Array
    away: Array
    slab: Slab
    tolerances: Array
    samples: float
    surprise: Array

    def weighted(self, scale: Array, temper: float = TEMPER) -> Array:
        """Return the products over all channels, those of large errors counting less."""
        return np.asarray(np.tensordot(1.0 / (temper * scale**2), self.products, 1), dtype=float)

    def parts(self, scale: Array, temper: float = TEMPER) -> Marginal:
        """Return the marginal over the parts alone, at the values."""
        kept = np.r_[0, 1 + self.away.size:1 + self.away.size + self.tolerances.size]
        return Marginal(self.weighted(scale, temper)[np.ix_(kept, kept)], self.tolerances)

    def scale_of(self, deviations: Array) -> Array:
        """
        Return by how much errors exceed what the filter states, (m,), at least one.

        The likelihood is greatest with errors as large as they are; that they are smaller than
        what every model is allowed to miss tells nothing.
        """
        left = np.concatenate([[1.0], np.zeros(self.away.size), deviations])
        power = np.maximum(np.einsum('i,mij,j->m', left, self.products, left), 0.0)
        return np.maximum(np.sqrt(power / self.samples), 1.0)

    def scaled(self, temper: float = TEMPER) -> Array:
        """
        Return the likeliest scale of each channel with the parts as they then are, (m,).

        Raises
        ------
        LinAlgError
            Where the prediction is not finite.

        """
        scale = self.scale_of(np.zeros(self.tolerances.size))
        for _ in range(ROUNDS):
            before, scale = scale, self.scale_of(self.parts(scale, temper).mean)
            if np.max(np.abs(np.log(scale / before))) < SETTLED:
                break
        return scale

    def joined(self, scale: Array, temper: float = TEMPER) -> Marginal:
        """Return the marginal over values, from the centres of their slabs, and parts."""
        move = np.eye(len(self.products[0]))
        move[1:1 + self.away.size, 0] = -self.away
        return Marginal(move.T @ self.weighted(scale, temper) @ move,
                        np.concatenate([self.slab.width, self.tolerances]))

    def at_centre(self, places: Collection[int]) -> Moments:
        """Return the same with some values at the centres of their slabs for certain."""
        move = np.eye(len(self.products[0]))
        move[1 + np.array(places, dtype=int), 0] = -self.away[list(places)]
        return replace(self, products=move.T @ self.products @ move).without(places)

    def without(self, places: Collection[int]) -> Moments:
        """Return the same with some values as they are for certain."""
        kept = np.delete(np.arange(len(self.products[0])), [1 + place for place in places])
        rest = np.setdiff1d(np.arange(self.away.size), list(places))
        return replace(self, products=self.products[:, kept[:, None], kept],
                       away=self.away[rest], slab=self.slab.kept(rest))

    def log_evidence(self, scale: Array, temper: float = TEMPER) -> float:
        """
        Return the evidence by Laplace's method, nats; exact where all is linear.

        Where a value may be at the centre of its slab for certain, the mean of both.
        """
        may = np.flatnonzero(self.slab.spiked).tolist()
        some = [places for count in range(len(may) + 1) for places in combinations(may, count)]
        each = [self.at_centre(places)._of_slabs(scale, temper) for places in some]
        return float(np.logaddexp.reduce(each)) - math.log(len(some))

    def _of_slabs(self, scale: Array, temper: float) -> float:
        wide, k = self.joined(scale, temper), self.away.size
        mean, variance = wide.mean[:k], np.diagonal(wide.covariance)[:k]
        # At the point; where a value lies at the end of a one-sided slab, at the optimum beyond.
        ends = (self.slab.sided != 0.0) & (self.away == 0.0)
        at = wide.quadratic if ends.any() else self.parts(scale, temper).quadratic + float(
            np.sum((self.away / self.slab.width)**2))
        likely = -0.5 * at - wide.half_log_determinant
        likely -= float(np.sum(self.samples * np.log(scale) + self.surprise)) / temper
        return likely + self.slab.log_inside(np.where(ends, mean, self.away), variance)
