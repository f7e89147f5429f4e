"""
A fitted set of causes as sufficient statistics: its evidence at any error scale and temper.

A fit computes them at its linearisation point; evidence, covariance and error scales follow from
them without another pass through the record.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
import math

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.likelihood.evidence import GaussianMarginal, ParameterPrior
import numpy as np

# Exponent 1 / TEMPER of the likelihood: so many samples count as one. With 16 the parts of clean
# arms, which are known, are as far off as stated in the worst group and most probable over all
# (benchmarks/temper.py, docs/evidence.md).
TEMPER = 16.0
# Relative change at which the error scales have converged, and iterations at most. The evidence is
# then off by twice its square for each effective sample, 1e-3 nats.
SCALE_TOLERANCE, MAX_SCALE_ITERATIONS = 1e-3, 20


@dataclass(frozen=True)
class SufficientStatistics:
    """
    Products of [residual, Jacobian in the values, Jacobian in the parts], by channel.

    The likelihood is tempered, and the errors of channel c are `error_scale[c]` times as large as
    the filter states: each sample has the variance TEMPER * error_scale^2.

    Attributes
    ----------
    products : Array
        (m, 1 + k + p, 1 + k + p).
    offsets : Array
        Values less the centres of their priors, (k,).
    prior : ParameterPrior
        Of the values.
    tolerances : Array
        Prior standard deviations of the parts, (p,).
    samples : float
        Of each channel.
    channel_log_determinants : Array
        Half the log-determinant of the stated covariance, by channel, nats, (m,).

    """

    products: Array
    offsets: Array
    prior: ParameterPrior
    tolerances: Array
    samples: float
    channel_log_determinants: Array

    @cached_property
    def widths(self) -> Array:
        """Return the standard deviations of Gaussians that stand for the prior, (k,)."""
        return self.prior.working_width(self.offsets)

    def weighted_products(self, error_scale: Array, temper: float = TEMPER) -> Array:
        """Return the products (a, a) over channels, each over its error scale (m,) squared."""
        return np.asarray(np.tensordot(1.0 / (temper * error_scale**2), self.products, 1),
                          dtype=float)

    def part_marginal(self, error_scale: Array, temper: float = TEMPER) -> GaussianMarginal:
        """Return the marginal over the parts (p,), given the values, for error scales (m,)."""
        kept = np.r_[0, 1 + self.offsets.size:1 + self.offsets.size + self.tolerances.size]
        products = self.weighted_products(error_scale, temper)
        return GaussianMarginal(products[np.ix_(kept, kept)], self.tolerances)

    def error_scale_at(self, deviations: Array) -> Array:
        """
        Return the likeliest error scales given the parts' deviations (p,), at least 1, (m,).

        Errors that are smaller than every model is allowed to make carry no information.
        """
        x = np.concatenate([[1.0], np.zeros(self.offsets.size), deviations])
        power = np.maximum(np.einsum('i,mij,j->m', x, self.products, x), 0.0)
        return np.maximum(np.sqrt(power / self.samples), 1.0)

    def likeliest_error_scale(self, temper: float = TEMPER) -> Array:
        """
        Return the likeliest error scales with the parts at their posterior mean, (m,).

        Raises
        ------
        LinAlgError
            Where the prediction is not finite.

        """
        error_scale = self.error_scale_at(np.zeros(self.tolerances.size))
        for _ in range(MAX_SCALE_ITERATIONS):
            before = error_scale
            error_scale = self.error_scale_at(self.part_marginal(before, temper).mean)
            if np.max(np.abs(np.log(error_scale / before))) < SCALE_TOLERANCE:
                break
        return error_scale

    def joint_marginal(self, error_scale: Array, temper: float = TEMPER) -> GaussianMarginal:
        """Return the marginal over values, from their priors' centres, and parts, (k + p,)."""
        shift = np.eye(len(self.products[0]))
        shift[1:1 + self.offsets.size, 0] = -self.offsets
        return GaussianMarginal(shift.T @ self.weighted_products(error_scale, temper) @ shift,
                                np.concatenate([self.widths, self.tolerances]))

    def fixed_at_centre(self, indices: Collection[int]) -> SufficientStatistics:
        """Return the statistics with some values fixed at the centres of their priors."""
        shift = np.eye(len(self.products[0]))
        shift[1 + np.array(indices, dtype=int), 0] = -self.offsets[list(indices)]
        return replace(self, products=shift.T @ self.products @ shift).held_fixed(indices)

    def held_fixed(self, indices: Collection[int]) -> SufficientStatistics:
        """Return the statistics with some values fixed as they are."""
        kept = np.delete(np.arange(len(self.products[0])), [1 + index for index in indices])
        rest = np.setdiff1d(np.arange(self.offsets.size), list(indices))
        return replace(self, products=self.products[:, kept[:, None], kept],
                       offsets=self.offsets[rest], prior=self.prior.subset(rest))

    def log_evidence(self, error_scale: Array, temper: float = TEMPER) -> float:
        """
        Return the log-evidence by Laplace's method, nats; exact where all is linear.

        With spikes in the prior, it is that of the mixture over all of them being true or not.
        """
        spiked = np.flatnonzero(self.prior.spiked).tolist()
        subsets = [indices for count in range(len(spiked) + 1)
                   for indices in combinations(spiked, count)]
        each = [self.fixed_at_centre(indices)._laplace_evidence(error_scale, temper)
                for indices in subsets]
        return float(np.logaddexp.reduce(each)) - math.log(len(subsets))

    def _laplace_evidence(self, error_scale: Array, temper: float) -> float:
        joint, k = self.joint_marginal(error_scale, temper), self.offsets.size
        mean, variance = joint.mean[:k], np.diagonal(joint.covariance)[:k]
        # Expanded at the values; where one is at the end of its prior, the gradient there is not
        # zero, and the expansion is at the optimum beyond the end.
        at_end = (self.offsets <= self.prior.low) | (self.offsets >= self.prior.high)
        if at_end.any():
            quadratic = joint.quadratic
        else:
            quadratic = self.part_marginal(error_scale, temper).quadratic + float(
                np.sum((self.offsets / self.widths)**2))
        evidence = -0.5 * quadratic - joint.half_log_determinant
        evidence -= float(np.sum(self.samples * np.log(error_scale)
                                 + self.channel_log_determinants)) / temper
        return evidence + self.prior.log_correction(self.offsets, mean, variance)
