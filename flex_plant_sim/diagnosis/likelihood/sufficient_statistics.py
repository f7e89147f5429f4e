"""A fitted set of causes as the products of its residual and columns: evidence at any scale."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from itertools import combinations
import math

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.likelihood.evidence import GaussianMarginal, ParameterPrior
import numpy as np

# So many samples count as one: then the parts of clean arms, which are known, are as far off as
# stated where that is worst, and likeliest on all (benchmarks/temper.py, docs/evidence.md).
TEMPER = 16.0
# Of a scale, which is likeliest: the evidence is off by twice its square for each sample that
# counts, 1e-3 nats; and rounds at most.
SCALE_TOLERANCE, MAX_SCALE_ITERATIONS = 1e-3, 20


@dataclass(frozen=True)
class SufficientStatistics:
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
    offsets: Array
    prior: ParameterPrior
    tolerances: Array
    samples: float
    channel_log_determinants: Array

    def weighted_products(self, error_scale: Array, temper: float = TEMPER) -> Array:
        """Return the products over all channels, those of large errors counting less."""
        return np.asarray(np.tensordot(1.0 / (temper * error_scale**2), self.products, 1), dtype=float)

    def part_marginal(self, error_scale: Array, temper: float = TEMPER) -> GaussianMarginal:
        """Return the marginal over the parts alone, at the values."""
        kept = np.r_[0, 1 + self.offsets.size:1 + self.offsets.size + self.tolerances.size]
        return GaussianMarginal(self.weighted_products(error_scale, temper)[np.ix_(kept, kept)], self.tolerances)

    def error_scale_at(self, deviations: Array) -> Array:
        """
        Return by how much errors exceed what the filter states, (m,), at least one.

        The likelihood is greatest with errors as large as they are; that they are smaller than
        what every model is allowed to miss tells nothing.
        """
        left = np.concatenate([[1.0], np.zeros(self.offsets.size), deviations])
        power = np.maximum(np.einsum('i,mij,j->m', left, self.products, left), 0.0)
        return np.maximum(np.sqrt(power / self.samples), 1.0)

    def likeliest_error_scale(self, temper: float = TEMPER) -> Array:
        """
        Return the likeliest scale of each channel with the parts as they then are, (m,).

        Raises
        ------
        LinAlgError
            Where the prediction is not finite.

        """
        error_scale = self.error_scale_at(np.zeros(self.tolerances.size))
        for _ in range(MAX_SCALE_ITERATIONS):
            before, error_scale = error_scale, self.error_scale_at(self.part_marginal(error_scale, temper).mean)
            if np.max(np.abs(np.log(error_scale / before))) < SCALE_TOLERANCE:
                break
        return error_scale

    def joint_marginal(self, error_scale: Array, temper: float = TEMPER) -> GaussianMarginal:
        """Return the marginal over values, from the centres of their slabs, and parts."""
        move = np.eye(len(self.products[0]))
        move[1:1 + self.offsets.size, 0] = -self.offsets
        return GaussianMarginal(move.T @ self.weighted_products(error_scale, temper) @ move,
                        np.concatenate([self.prior.width, self.tolerances]))

    def fixed_at_centre(self, indices: Collection[int]) -> SufficientStatistics:
        """Return the same with some values at the centres of their slabs for certain."""
        move = np.eye(len(self.products[0]))
        move[1 + np.array(indices, dtype=int), 0] = -self.offsets[list(indices)]
        return replace(self, products=move.T @ self.products @ move).held_fixed(indices)

    def held_fixed(self, indices: Collection[int]) -> SufficientStatistics:
        """Return the same with some values as they are for certain."""
        kept = np.delete(np.arange(len(self.products[0])), [1 + place for place in indices])
        rest = np.setdiff1d(np.arange(self.offsets.size), list(indices))
        return replace(self, products=self.products[:, kept[:, None], kept],
                       offsets=self.offsets[rest], prior=self.prior.subset(rest))

    def log_evidence(self, error_scale: Array, temper: float = TEMPER) -> float:
        """
        Return the evidence by Laplace's method, nats; exact where all is linear.

        Where a value may be at the centre of its slab for certain, the mean of both.
        """
        may = np.flatnonzero(self.prior.spiked).tolist()
        some = [indices for count in range(len(may) + 1) for indices in combinations(may, count)]
        each = [self.fixed_at_centre(indices)._laplace_evidence(error_scale, temper) for indices in some]
        return float(np.logaddexp.reduce(each)) - math.log(len(some))

    def _laplace_evidence(self, error_scale: Array, temper: float) -> float:
        wide, k = self.joint_marginal(error_scale, temper), self.offsets.size
        mean, variance = wide.mean[:k], np.diagonal(wide.covariance)[:k]
        # At the point; where a value lies at the end of a one-sided slab, at the optimum beyond.
        ends = (self.prior.one_sided != 0.0) & (self.offsets == 0.0)
        at = wide.quadratic if ends.any() else self.part_marginal(error_scale, temper).quadratic + float(
            np.sum((self.offsets / self.prior.width)**2))
        likely = -0.5 * at - wide.half_log_determinant
        likely -= float(np.sum(self.samples * np.log(error_scale) + self.channel_log_determinants)) / temper
        return likely + self.prior.log_truncation(np.where(ends, mean, self.offsets), variance)
