"""The algebra of one likelihood: Gaussian deviations integrated out of whitened residuals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from flex_plant_sim.arm.second_order import Array
import numpy as np
from scipy.special import log_ndtr


class Marginal:
    """
    Residuals e = r + J b with white noise of unit variance and b ~ N(0, diag(prior^2)).

    Then r ~ N(0, W) with W = 1 + J Lambda J'. By Woodbury's identity nothing larger than (p, p)
    is factored: A = 1 + K' K, K = J Lambda^(1/2), which is never singular.

    Parameters
    ----------
    columns : Array
        J, whitened, (M, p).
    prior : Array
        Standard deviations of b, (p,).

    """

    def __init__(self, columns: Array, prior: Array):
        self.columns, self.prior = columns * prior, prior
        self.gram = self.columns.T @ self.columns

    @cached_property
    def factor(self) -> Array:
        """Return L^-1 with L L' = A, (p, p)."""
        lower = np.linalg.cholesky(np.eye(self.prior.size) + self.gram)
        return np.linalg.inv(lower)

    @property
    def half_log_determinant(self) -> float:
        """Return ln|W| / 2."""
        return -float(np.sum(np.log(np.diagonal(self.factor))))

    def explained(self, residual: Array) -> Array:
        """Return L^-1 K' r for r (…, M): (…, p); what b takes out of r, in whitened terms."""
        return residual @ self.columns @ self.factor.T

    def inner(self, left: Array, right: Array) -> Array:
        """Return left W^-1 right' for rows (…, M)."""
        return left @ right.T - self.explained(left) @ self.explained(right).T

    def quadratic(self, residual: Array) -> float:
        """Return r' W^-1 r; infinite where r is not finite."""
        if not np.all(np.isfinite(residual)):
            return float('inf')
        taken = self.explained(residual)
        return float(residual @ residual - taken @ taken)

    def log_evidence(self, residual: Array) -> float:
        """Return ln p(r) less that of white noise at zero, nats; -inf where r is not finite."""
        return -0.5 * self.quadratic(residual) - self.half_log_determinant

    def mean(self, residual: Array) -> Array:
        """Return the posterior mean of b, (p,)."""
        return -self.prior * (self.factor.T @ self.explained(residual))

    @property
    def covariance(self) -> Array:
        """Return the posterior covariance of b, (p, p)."""
        root = self.factor * self.prior
        return root.T @ root

    def joined(self, columns: Array, prior: Array) -> Marginal:
        """Return the marginal with further columns (M, k) in front; the others' gram is kept."""
        wide = object.__new__(Marginal)
        front = columns * prior
        cross = front.T @ self.columns
        wide.columns = np.concatenate([front, self.columns], axis=1)
        wide.prior = np.concatenate([prior, self.prior])
        wide.gram = np.block([[front.T @ front, cross], [cross.T, self.gram]])
        return wide


@dataclass(frozen=True)
class Slab:
    """
    The prior of an effect's parameters.

    Attributes
    ----------
    centre, width : Array
        Mean and standard deviation of a Gaussian, (k,).
    sided : Array
        True where only values on one side of the centre exist: +1 above, -1 below, 0 both, (k,).

    """

    centre: Array
    width: Array
    sided: Array

    def log_inside(self, mean: Array, variance: Array) -> float:
        """
        Return the logarithm of posterior over prior mass on the sides that exist, nats.

        Parameters
        ----------
        mean, variance : Array
            Of the posterior of value - centre, (k,).

        """
        ones = self.sided != 0.0
        reach = (self.sided * mean)[ones] / np.sqrt(variance[ones])
        return float(np.sum(log_ndtr(reach)) + np.log(2.0) * ones.sum())


def detectable(information: float, width: float, price: float) -> float:
    """
    Return the size at which the evidence for a linear effect turns, in its unit.

    With J' W^-1 J = h and a slab of width w, a true size s moves the log-evidence on average by
    (1 + h s^2) w^2 h / (2 (1 + w^2 h)) - ln(1 + w^2 h) / 2, to be more than the price.

    Parameters
    ----------
    information : float
        h.
    width : float
        w.
    price : float
        Logarithm of the prior odds against the effect, nats.

    """
    gain = width**2 * information
    if not (np.isfinite(gain) and gain > 0.0):
        return float('inf')
    needed = (2.0 * price + np.log1p(gain)) * (1.0 + gain) / gain
    return float(np.sqrt(max(needed - 1.0, 0.0) / information))
