"""
The algebra of evidence: Gaussian deviations integrated out of whitened residuals.

`SufficientStatistics` applies it to fits, `ProposalScorer` to proposals, `detection` to limits.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
import math

from flex_plant_sim.arm.second_order import Array
import numpy as np
from scipy.special import log_ndtr


class GaussianMarginal:
    """
    The marginal of residuals r = e - J x, with white noise e of unit variance and Gaussian x.

    With x ~ N(0, Lambda), Lambda = diag(prior_widths^2), r ~ N(0, W) and W = 1 + J Lambda J'. By
    Woodbury's identity no matrix larger than (p, p) is factored: A = 1 + K' K, K = J Lambda^(1/2),
    which is never singular. Of r and J, only the products are needed.

    Parameters
    ----------
    products : Array
        [r, J]' [r, J], (1 + p, 1 + p).
    prior_widths : Array
        Standard deviations of x, (p,).

    Attributes
    ----------
    residual_power : float
        r' r.
    scaled_gradient : Array
        K' r, (p,).
    scaled_gram : Array
        K' K, (p, p).

    """

    def __init__(self, products: Array, prior_widths: Array):
        self.residual_power, self.prior_widths = float(products[0, 0]), prior_widths
        self.scaled_gradient = prior_widths * products[1:, 0]
        self.scaled_gram = prior_widths[:, None] * products[1:, 1:] * prior_widths

    @cached_property
    def inverse_factor(self) -> Array:
        """
        Return L^-1 with L L' = A, (p, p).

        Raises
        ------
        LinAlgError
            Where J is not finite.

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
    def mean(self) -> Array:
        """Return the posterior mean of x, (p,)."""
        solved = self.inverse_factor.T @ (self.inverse_factor @ self.scaled_gradient)
        return -self.prior_widths * solved

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
    Return a covariance (p, p), with variances at least those of the sandwich estimate.

    The sandwich is C S C, with S the covariance of the sum of the windows' scores. It holds for
    errors of any kind that are independent between windows: H. White, Econometrica 50 (1982); for
    clusters, K.-Y. Liang and S. L. Zeger, Biometrika 73 (1986). Correlations are those of C.

    Parameters
    ----------
    covariance : Array
        C, under white errors, (p, p).
    scores : Array
        d ln p / dx of each window at the optimum, (p, W).

    """
    count = scores.shape[1]
    apart = covariance @ (scores - scores.mean(axis=1, keepdims=True))
    variance = count / max(count - 1, 1) * np.sum(apart**2, axis=1)
    wider = np.sqrt(np.maximum(variance / np.diagonal(covariance), 1.0))
    return wider[:, None] * covariance * wider


# Gauss and Hermite's rule of three nodes for a Gaussian: abscissae and weights.
NODES = np.array([-math.sqrt(3.0), 0.0, math.sqrt(3.0)])
LOG_WEIGHTS = np.log([1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0])


@dataclass(frozen=True)
class ParameterPrior:
    """
    The prior of an effect's parameters: slabs within bounds, some of them with a spike.

    A slab is Gaussian, with a width whose logarithm is Gaussian; three widths stand for all. At
    values, the Gaussian of the `working_width` has the same slope as the slab.

    Attributes
    ----------
    centre, width : Array
        Mean and, at the likeliest width, standard deviation of the slab, (k,).
    low, high : Array
        Values less the centre exist between these; -inf and inf where it has no bounds, (k,).
    spiked : Array
        True where half of the prior is a spike at the centre, (k,).
    width_spread : Array
        Standard deviation of the width's logarithm, (k,).

    """

    centre: Array
    width: Array
    low: Array
    high: Array
    spiked: Array
    width_spread: Array

    def subset(self, indices: Array) -> ParameterPrior:
        """Return the prior of some of the parameters, by their indices."""
        return ParameterPrior(*(getattr(self, field.name)[indices] for field in fields(self)))

    @property
    def log_mass(self) -> Array:
        """Return the log-mass within the bounds of the Gaussian of the likeliest width, (k,)."""
        return log_mass(self.low / self.width, self.high / self.width)

    @property
    def widths(self) -> Array:
        """Return the widths that stand for all, (3, k)."""
        return np.asarray(self.width * np.exp(NODES[:, None] * self.width_spread))

    def _log_densities(self, offsets: Array) -> Array:
        """Return the log-density of values less the centres (k,) at each width, (3, k)."""
        return (LOG_WEIGHTS[:, None] - np.log(self.widths)
                - 0.5 * (offsets / self.widths)**2)

    def cost(self, offsets: Array) -> float:
        """Return minus the log-density at values less the centres, up to a constant, nats."""
        return -float(np.sum(np.logaddexp.reduce(self._log_densities(offsets), axis=0)))

    def working_width(self, offsets: Array) -> Array:
        """Return the width of the Gaussian with the slab's slope at values less the centres."""
        each = self._log_densities(offsets)
        share = np.exp(each - np.logaddexp.reduce(each, axis=0))
        return np.asarray(np.sum(share / self.widths**2, axis=0)**-0.5)

    def log_correction(self, offsets: Array, mean: Array, variance: Array) -> float:
        """
        Return what corrects the evidence under Gaussians of the working widths, nats.

        It is the log-ratio to the evidence under the slabs within their bounds.

        Parameters
        ----------
        offsets : Array
            Values less the centres where the working widths were taken, (k,).
        mean, variance : Array
            Of the posterior of value - centre under these, (k,).

        """
        working, widths = self.working_width(offsets), self.widths
        # The posterior mean of exp(-difference x^2 / 2), and the posterior times that.
        difference = widths**-2 - working**-2
        narrower = 1.0 + variance * difference
        ratio = (np.log(working / widths) - 0.5 * np.log(narrower)
                 - 0.5 * difference * mean**2 / narrower)
        centre, deviation = mean / narrower, np.sqrt(variance / narrower)
        inside = log_mass((self.low - centre) / deviation, (self.high - centre) / deviation)
        ratio += inside - log_mass(self.low / widths, self.high / widths)
        return float(np.sum(np.logaddexp.reduce(LOG_WEIGHTS[:, None] + ratio, axis=0)))


def log_mass(low: Array, high: Array) -> Array:
    """Return the logarithm of the standard Gaussian's mass between low and high > low."""
    # In the upper tail both distribution functions round to one: it is taken from below.
    flipped = low > 0.0
    below = log_ndtr(np.where(flipped, -high, low))
    above = log_ndtr(np.where(flipped, -low, high))
    return np.asarray(above + np.log1p(-np.exp(below - above)), dtype=float)


def detectable_size(information: float, width: float, price: float) -> float:
    """
    Return the size of a linear effect from which on its presence is favoured, in its unit.

    With information h = J' W^-1 J and a prior of width w, a true size s raises the log-evidence
    on average by (1 + h s^2) w^2 h / (2 (1 + w^2 h)) - ln(1 + w^2 h) / 2; this has to exceed the
    price.

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
