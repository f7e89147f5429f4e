"""
Events of every start and end on a grid of times, from the responses to sudden events.

`EventTimeIntegral` computes the responses. The evidence of all events, their estimate and its
uncertainty are algebra, as a gradual event's response is a weighted mean of sudden ones'.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.likelihood.evidence import GaussianMarginal, LOG_WEIGHTS
from flex_plant_sim.interval import CREDIBLE_LEVEL, Z95
import numpy as np

# Largest product of the distance between the responses of neighbouring times, nats, and their
# probability; where it is larger, a time is added between them. As increments of the response over
# time are independent, linear interpolation is wrong by a quarter of the distance in the middle.
MAX_INTERPOLATION_ERROR = 0.3
# Log-likelihood, nats, by which a mean may be below the most probable event and yet be stated.
MAX_MEAN_DEFICIT = 1.0
# Weight below which an event is left out of a mixture, as a share of the largest.
NEGLIGIBLE_WEIGHT = 1e-9


@dataclass(frozen=True)
class _Mixture:
    """
    A mixture of E events.

    Attributes
    ----------
    weight : Array
        Probability of each event, (E,).
    variance : Array
        Of each event's size, (E,).
    mean : Array
        Start, duration, size and all else given each event, (E, 3 + z).
    size_slope : Array
        Derivatives of these means in the size, (E, 3 + z).

    """

    weight: Array
    variance: Array
    mean: Array
    size_slope: Array

    @property
    def centre(self) -> Array:
        """Return the mean over all events, (3 + z,)."""
        return np.asarray(self.weight @ self.mean)

    def credible_reach(self, values: Array) -> Array:
        """Return the distance from some values within which 95 % of all means are, (3 + z,)."""
        distance = np.abs(self.mean - values)
        order = np.argsort(distance, axis=0)
        last = np.sum(np.cumsum(self.weight[order], axis=0) < CREDIBLE_LEVEL, axis=0)
        return np.take_along_axis(np.take_along_axis(distance, order, 0), last[None], 0)[0]


@dataclass(frozen=True)
class EventGrid:
    """
    Events of every start and end among T times; on the diagonal (T, T) they are sudden.

    Attributes
    ----------
    time : Array
        s, (T,).
    responses : Array
        Change of the residual by a sudden event of the given size at each time, (T, m, N).
    background : Array
        Residual without the event, and the Jacobian in all else (other values, counted from the
        centres of their priors, and parts), (1 + z, m, N).
    prior_widths : Array
        Prior standard deviations of all else, (z,).
    size_width : float
        Prior standard deviation of the event's size.
    duration_widths : Array
        Those of its duration that stand for all, see `ParameterPrior`, (3,).
    size : float
        Of the responses' events, counted from null.
    sudden_probability : float
        A priori.
    channel_weight : Array
        One over the variance of each channel's errors, (m,).
    sampling : float
        Time within which sudden events change the same samples, s.

    """

    time: Array
    responses: Array
    background: Array
    prior_widths: Array
    size_width: float
    duration_widths: Array
    size: float
    sudden_probability: float
    channel_weight: Array
    sampling: float

    @cached_property
    def _products(self) -> Array:
        """Return the weighted products of background and unit responses, (1 + z + T, …)."""
        rows = np.concatenate([self.background, self.responses / self.size])
        rows = (rows * np.sqrt(self.channel_weight)[:, None]).reshape(len(rows), -1)
        return np.asarray(rows @ rows.T)

    @cached_property
    def _else_posterior(self) -> tuple[Array, Array]:
        """Return covariance of all else, (z, z), and its shift by r and responses, (z, 1 + T)."""
        of_background = slice(0, len(self.background))
        marginal = GaussianMarginal(self._products[of_background, of_background],
                                    self.prior_widths)
        kept = np.r_[0, len(self.background):len(self._products)]
        return (marginal.covariance,
                -marginal.covariance @ self._products[1:len(self.background), kept])

    @cached_property
    def reduced_products(self) -> Array:
        """Return products of residual and responses, all else integrated out, (1 + T, 1 + T)."""
        kept = np.r_[0, len(self.background):len(self._products)]
        return self._products[np.ix_(kept, kept)] + self._products[
            kept, 1:len(self.background)] @ self._else_posterior[1]

    @cached_property
    def duration(self) -> Array:
        """Return the duration of each event, s, (T, T); negative where the end comes first."""
        return np.asarray(self.time[None] - self.time[:, None])

    @cached_property
    def _integral_weights(self) -> Array:
        """Return weights of the linear interpolant's integral up to each time, (T, T)."""
        gap, count = np.diff(self.time), self.time.size
        found = np.zeros((count, count))
        for k in range(1, count):
            found[k] = found[k - 1]
            found[k, k - 1:k + 1] += 0.5 * gap[k - 1]
        return found

    @cached_property
    def averaging_weights(self) -> Array:
        """Return each event's weights of sudden responses, (T, T, T): start, end, which."""
        with np.errstate(divide='ignore', invalid='ignore'):
            found = (self._integral_weights[None]
                     - self._integral_weights[:, None]) / self.duration[..., None]
        found[np.diag_indices(self.time.size)] = np.eye(self.time.size)
        return np.asarray(found)

    def averaging_weights_of(self, start: float, duration: float) -> Array:
        """Return the weights of sudden responses for any event, (T,)."""
        if duration == 0.0:
            return self._interpolation(start)[0]
        return (self._interpolation(start + duration)[1]
                - self._interpolation(start)[1]) / duration

    def _interpolation(self, time: float) -> tuple[Array, Array]:
        """Return weights of the linear interpolant at a time and of its integral, (T,) each."""
        k = int(np.clip(np.searchsorted(self.time, time, 'right') - 1, 0, self.time.size - 2))
        gap, late = self.time[k + 1] - self.time[k], time - self.time[k]
        at, until = np.zeros(self.time.size), self._integral_weights[k].copy()
        at[k:k + 2] = 1.0 - late / gap, late / gap
        until[k:k + 2] += late - 0.5 * late**2 / gap, 0.5 * late**2 / gap
        return at, until

    def size_posterior(self, weights: Array) -> tuple[Array, Array]:
        """Return mean and variance of the size given events' weights (…, T), (…) each."""
        precision = np.einsum('...k,...k', weights @ self.reduced_products[1:, 1:],
                              weights) + self.size_width**-2
        return -(weights @ self.reduced_products[1:, 0]) / precision, 1.0 / precision

    def log_likelihood_of(self, weights: Array) -> Array:
        """Return ln p of the record given events' weights (…, T), up to a constant, nats, (…)."""
        mean, variance = self.size_posterior(weights)
        return np.asarray(0.5 * (mean**2 / variance
                                 + np.log(variance / self.size_width**2)))

    @cached_property
    def log_likelihood(self) -> Array:
        """Return ln p of the record given each event, nats, (T, T); -inf if the end is first."""
        return np.where(self.duration >= 0.0, self.log_likelihood_of(self.averaging_weights),
                        -np.inf)

    @cached_property
    def gradual_log_density(self) -> Array:
        """Return ln of likelihood times prior density, s^-2, of gradual events, (T, T)."""
        widths = self.duration_widths[:, None, None]
        density = np.logaddexp.reduce(LOG_WEIGHTS[:, None, None] - np.log(widths)
                                      - 0.5 * (self.duration / widths)**2, axis=0)
        constant = np.sqrt(2.0 / np.pi) * (1.0 - self.sudden_probability) / np.ptp(self.time)
        return np.asarray(self.log_likelihood + density + np.log(constant))

    @cached_property
    def sudden_log_density(self) -> Array:
        """Return ln of likelihood times prior density, 1/s, of sudden events, (T,)."""
        with np.errstate(divide='ignore'):
            return np.diagonal(self.log_likelihood) + np.log(
                self.sudden_probability / np.ptp(self.time))

    @cached_property
    def log_weights(self) -> tuple[Array, Array]:
        """Return ln of each cell's integral, nats: of sudden events, (T,), and gradual, (T, T)."""
        gap = np.diff(self.time)
        width = 0.5 * (np.r_[gap, 0.0] + np.r_[0.0, gap])
        area = np.outer(width, width)
        # Half of a cell on the diagonal has a negative duration.
        area[np.diag_indices(width.size)] *= 0.5
        return self.sudden_log_density + np.log(width), self.gradual_log_density + np.log(area)

    @cached_property
    def log_integral(self) -> float:
        """Return ln p integrated over all events, nats, up to the same constant."""
        sudden, gradual = self.log_weights
        return float(np.logaddexp.reduce(np.r_[sudden, gradual.ravel()]))

    @cached_property
    def probability(self) -> tuple[Array, Array]:
        """Return the probability of each sudden event, (T,), and each gradual one, (T, T)."""
        sudden, gradual = self.log_weights
        return np.exp(sudden - self.log_integral), np.exp(gradual - self.log_integral)

    @property
    def refinement_times(self) -> Array:
        """Return times to add to the grid, see MAX_INTERPOLATION_ERROR, (k,)."""
        sudden, gradual = self.probability
        share = sudden + gradual.sum(axis=0) + gradual.sum(axis=1)
        best = np.unravel_index(np.argmax(self.log_likelihood), self.log_likelihood.shape)
        size = self.size_posterior(self.averaging_weights[best])[0]
        products = self.reduced_products[1:, 1:]
        power = np.diagonal(products)
        distance = 0.5 * size**2 * (power[1:] + power[:-1] - 2.0 * np.diagonal(products, 1))
        wanted = distance * (share[1:] + share[:-1]) > MAX_INTERPOLATION_ERROR
        return 0.5 * (self.time[1:] + self.time[:-1])[
            wanted & (np.diff(self.time) > self.sampling)]

    def _mixture(self, weight: Array) -> _Mixture:
        """Return the mixture of events with weights, (T, T)."""
        kept = np.nonzero(weight > NEGLIGIBLE_WEIGHT * weight.max())
        weights, (_, response) = self.averaging_weights[kept], self._else_posterior
        size, variance = self.size_posterior(weights)
        slope = weights @ response[:, 1:].T
        return _Mixture(
            weight[kept] / weight[kept].sum(), variance,
            np.column_stack([self.time[kept[0]], self.duration[kept], size,
                             response[:, 0] + size[:, None] * slope]),
            np.column_stack([np.zeros((size.size, 2)), np.ones(size.size), slope]))

    def estimate(self) -> Array:
        """
        Return the event that is stated, with the size and all else given it.

        The mean over the more probable kind, sudden or gradual; the most probable event of that
        kind where the mean is less likely by MAX_MEAN_DEFICIT, as between two maxima.

        Returns
        -------
        Array
            Start, duration, size from null, all else from its centre, (3 + z,).

        """
        sudden, gradual = self.probability
        weight, density = gradual, self.gradual_log_density
        if sudden.sum() > gradual.sum():
            weight = np.diag(sudden)
            density = np.where(weight > 0.0, self.log_likelihood, -np.inf)
        mean, best = self._mixture(weight).centre, density == density.max()
        of_mean = self.log_likelihood_of(self.averaging_weights_of(*mean[:2]))
        if of_mean > self.log_likelihood[best].max() - MAX_MEAN_DEFICIT:
            return mean
        return self._mixture(1.0 * best).centre

    def mean_square_deviation(self, values: Array) -> Array:
        """
        Return mean products of deviations from values as of `estimate`, (3 + z, 3 + z).

        Over all events. Times and durations are widened to hold 95 % of the events within Z95
        deviations.
        """
        sudden, gradual = self.probability
        mixture = self._mixture(gradual + np.diag(sudden))
        deviation = mixture.mean - values
        found = (deviation * mixture.weight[:, None]).T @ deviation
        found += (mixture.size_slope
                  * (mixture.weight * mixture.variance)[:, None]).T @ mixture.size_slope
        found[3:, 3:] += self._else_posterior[0]
        wider = np.maximum(
            mixture.credible_reach(values) / (Z95 * np.sqrt(np.diagonal(found))), 1.0)
        wider[2:] = 1.0
        return np.asarray(wider[:, None] * found * wider)
