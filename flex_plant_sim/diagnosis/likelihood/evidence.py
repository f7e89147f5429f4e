"""The algebra of one likelihood: Gaussian deviations integrated out of whitened residuals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from flex_plant_sim.arm.second_order import Array
import numpy as np
from scipy.special import log_ndtr


class GaussianMarginal:
    """
    Residuals e = r + J x with white noise of unit variance and x ~ N(0, diag(prior^2)).

    Then r ~ N(0, W) with W = 1 + J Lambda J'. By Woodbury's identity nothing larger than (p, p)
    is factored: A = 1 + K' K, K = J Lambda^(1/2), which is never singular. All that is asked of
    r and J are their products.

    Parameters
    ----------
    products : Array
        [r, J]' [r, J], (1 + p, 1 + p).
    prior : Array
        Standard deviations of x, (p,).

    """

    def __init__(self, products: Array, prior_widths: Array):
        self.residual_power, self.prior_widths = float(products[0, 0]), prior_widths
        self.scaled_gradient = prior_widths * products[1:, 0]
        self.scaled_gram = prior_widths[:, None] * products[1:, 1:] * prior_widths

    @classmethod
    def of(cls, residual: Array, columns: Array, prior_widths: Array) -> GaussianMarginal:
        """Return the marginal of residuals (M,) with columns (M, p)."""
        both = np.column_stack([residual, columns])
        return cls(both.T @ both, prior_widths)

    @cached_property
    def inverse_factor(self) -> Array:
        """
        Return L^-1 with L L' = A, (p, p).

        Raises
        ------
        LinAlgError
            Where the columns are not finite.

        """
        if not np.all(np.isfinite(self.scaled_gram)):
            raise np.linalg.LinAlgError('no finite prediction')
        return np.linalg.inv(np.linalg.cholesky(np.eye(self.prior_widths.size) + self.scaled_gram))

    @property
    def half_log_determinant(self) -> float:
        """Return ln|W| / 2."""
        return -float(np.sum(np.log(np.diagonal(self.inverse_factor))))

    @property
    def quadratic(self) -> float:
        """Return r' W^-1 r; infinite where r is not finite."""
        if not (np.isfinite(self.residual_power) and np.all(np.isfinite(self.scaled_gradient))):
            return float('inf')
        return self.residual_power - float(np.sum((self.inverse_factor @ self.scaled_gradient)**2))

    @property
    def log_evidence(self) -> float:
        """Return ln p(r) less that of white noise at zero, nats; -inf where r is not finite."""
        return -0.5 * self.quadratic - self.half_log_determinant

    @property
    def mean(self) -> Array:
        """Return the posterior mean of x, (p,)."""
        return -self.prior_widths * (self.inverse_factor.T @ (self.inverse_factor @ self.scaled_gradient))

    @property
    def covariance(self) -> Array:
        """Return the posterior covariance of x, (p, p)."""
        root = self.inverse_factor * self.prior_widths
        return root.T @ root


def channel_products(left: Array, right: Array) -> Array:
    """Return sums over samples, (m, a, b), of (a, m, N) times (b, m, N)."""
    return np.matmul(left.transpose(1, 0, 2), right.transpose(1, 2, 0))


def sandwich_covariance(covariance: Array, scores: Array) -> Array:
    """
    Return a covariance (p, p), its deviations at least as large as windows disagree by.

    C J C, with J the covariance of the sum of the windows' scores: right whatever errors are, as
    long as windows err independently. H. White, Econometrica 50 (1982); for clusters, Liang and
    Zeger, Biometrika 73 (1986).

    Parameters
    ----------
    covariance : Array
        C, as errors that are white would have it.
    scores : Array
        d ln p / dx of each window at the optimum, (p, W).

    """
    count = scores.shape[1]
    apart = covariance @ (scores - scores.mean(axis=1, keepdims=True))
    variance = count / max(count - 1, 1) * np.sum(apart**2, axis=1)
    wider = np.sqrt(np.maximum(variance / np.diagonal(covariance), 1.0))
    return wider[:, None] * covariance * wider


@dataclass(frozen=True)
class ParameterPrior:
    """
    The prior of an effect's parameters.

    Attributes
    ----------
    centre, width : Array
        Mean and standard deviation of a Gaussian, (k,).
    sided : Array
        True where only values on one side of the centre exist: +1 above, -1 below, 0 both, (k,).
    spiked : Array
        True where a value is at the centre itself as likely as not, and the Gaussian is the other
        half, (k,).

    """

    centre: Array
    width: Array
    one_sided: Array
    spiked: Array

    def subset(self, rows: Array) -> ParameterPrior:
        """Return the prior of some of the parameters alone, by places."""
        return ParameterPrior(self.centre[rows], self.width[rows], self.one_sided[rows], self.spiked[rows])

    def log_truncation(self, mean: Array, variance: Array) -> float:
        """
        Return the logarithm of posterior over prior mass on the sides that exist, nats.

        Parameters
        ----------
        mean, variance : Array
            Of the posterior of value - centre, (k,).

        """
        ones = self.one_sided != 0.0
        reach = (self.one_sided * mean)[ones] / np.sqrt(variance[ones])
        return float(np.sum(log_ndtr(reach)) + np.log(2.0) * ones.sum())


def detectable_size(information: float, width: float, price: float) -> float:
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
