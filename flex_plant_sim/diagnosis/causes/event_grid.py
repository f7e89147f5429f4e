"""Events of every start and end, from the responses to sudden ones: their evidence by algebra."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.likelihood.evidence import GaussianMarginal
from flex_plant_sim.interval import Z95
import numpy as np

# Between two times whose responses are apart by q nats and that have a share of the probability,
# others are looked at until that share of q is less: as increments of the response over time are
# independent, the middle is off the line between them by q / 4.
MAX_INTERPOLATION_ERROR = 0.3
# What is less likely by so many nats is not stated for being the mean.
MAX_MEAN_DEFICIT = 1.0
# Less than this of the most counts for nothing.
NEGLIGIBLE_WEIGHT = 1e-9
# As all that is stated: 95 %.
CREDIBLE_LEVEL = 0.95


@dataclass(frozen=True)
class _Mixture:
    """Weights of events and variances of their sizes, (E,); all values, and along the size."""

    channel_weight: Array
    variance: Array
    mean: Array
    size_slope: Array

    @property
    def centre(self) -> Array:
        """Return the mean over all, (3 + z,)."""
        return np.asarray(self.channel_weight @ self.mean)

    def credible_reach(self, values: Array) -> Array:
        """Return how far from some values 95 % of all means are, (3 + z,)."""
        away = np.abs(self.mean - values)
        order = np.argsort(away, axis=0)
        last = np.sum(np.cumsum(self.channel_weight[order], axis=0) < CREDIBLE_LEVEL, axis=0)
        return np.take_along_axis(np.take_along_axis(away, order, 0), last[None], 0)[0]


@dataclass(frozen=True)
class EventGrid:
    """
    Events of every start and end among some times, those at once on the diagonal.

    Attributes
    ----------
    time : Array
        s, (T,).
    rows : Array
        What each time's sudden event, as large as at a point, adds to the residual, (T, m, N).
    rest : Array
        Residual without it and the columns of all else, others' values from the centres of their
        slabs, (1 + z, m, N).
    prior : Array
        Standard deviations of all else, (z,).
    slab : tuple of float
        Standard deviation of the size and of the duration.
    size : float
        At the point, from null.
    sudden : float
        Prior probability that it takes no time.
    weight : Array
        Of each channel's samples, (m,).

    """

    time: Array
    responses: Array
    background: Array
    prior_widths: Array
    event_widths: tuple[float, float]
    size: float
    sudden_probability: float
    channel_weight: Array

    @cached_property
    def _products(self) -> Array:
        every = np.concatenate([self.background, self.responses / self.size])
        every = (every * np.sqrt(self.channel_weight)[:, None]).reshape(len(every), -1)
        return np.asarray(every @ every.T)

    @cached_property
    def _background_posterior(self) -> tuple[Array, Array]:
        """Return covariance (z, z) of all else without an event, and its response (z, 1 + T)."""
        some = slice(0, len(self.background))
        marginal = GaussianMarginal(self._products[some, some], self.prior_widths)
        kept = np.r_[0, len(self.background):len(self._products)]
        return marginal.covariance, -marginal.covariance @ self._products[1:len(self.background), kept]

    @cached_property
    def reduced_products(self) -> Array:
        """Return products of residual and rows with all else integrated out, (1 + T, 1 + T)."""
        kept = np.r_[0, len(self.background):len(self._products)]
        return self._products[np.ix_(kept, kept)] + self._products[
            kept, 1:len(self.background)] @ self._background_posterior[1]

    @cached_property
    def duration(self) -> Array:
        """Return how long each takes, (T, T); negative where an end is before the start."""
        return np.asarray(self.time[None] - self.time[:, None])

    @cached_property
    def _cumulative_weights(self) -> Array:
        """Return integrals over time up to each, of what lies between as lines, (T, T)."""
        gap, count = np.diff(self.time), self.time.size
        found = np.zeros((count, count))
        for k in range(1, count):
            found[k] = found[k - 1]
            found[k, k - 1:k + 1] += 0.5 * gap[k - 1]
        return found

    @cached_property
    def averaging_weights(self) -> Array:
        """Return of which sudden events each event is a mean, (T, T, T): start, end, which."""
        with np.errstate(divide='ignore', invalid='ignore'):
            found = (self._cumulative_weights[None] - self._cumulative_weights[:, None]) / self.duration[..., None]
        found[np.diag_indices(self.time.size)] = np.eye(self.time.size)
        return np.asarray(found)

    def averaging_weights_of(self, start: float, duration: float) -> Array:
        """Return the same of an event between the times, (T,)."""
        if duration == 0.0:
            return self._interpolation_weights(start)[0]
        return (self._interpolation_weights(start + duration)[1] - self._interpolation_weights(start)[1]) / duration

    def _interpolation_weights(self, time: float) -> tuple[Array, Array]:
        """Return the line between neighbours at a time, and its integral up to there, (T,)."""
        k = int(np.clip(np.searchsorted(self.time, time, 'right') - 1, 0, self.time.size - 2))
        gap, late = self.time[k + 1] - self.time[k], time - self.time[k]
        at, until = np.zeros(self.time.size), self._cumulative_weights[k].copy()
        at[k:k + 2] = 1.0 - late / gap, late / gap
        until[k:k + 2] += late - 0.5 * late**2 / gap, 0.5 * late**2 / gap
        return at, until

    def size_posterior(self, averaging_weights: Array) -> tuple[Array, Array]:
        """Return mean and variance of the size for events of some shares, (…, T), (…) each."""
        precision = np.einsum('...k,...k', averaging_weights @ self.reduced_products[1:, 1:], averaging_weights) + self.event_widths[0]**-2
        return -(averaging_weights @ self.reduced_products[1:, 0]) / precision, 1.0 / precision

    def log_likelihood_of(self, averaging_weights: Array) -> Array:
        """Return ln p of the record for events of some shares, less one for all, (…)."""
        mean, variance = self.size_posterior(averaging_weights)
        return np.asarray(0.5 * (mean**2 / variance + np.log(variance / self.event_widths[0]**2)))

    @cached_property
    def log_likelihood(self) -> Array:
        """Return ln p of the record for each event less one for all, (T, T); -inf before."""
        return np.where(self.duration >= 0.0, self.log_likelihood_of(self.averaging_weights), -np.inf)

    @cached_property
    def slow_log_density(self) -> Array:
        """Return ln of likelihood times prior density, s^-2, of each as a slow one, (T, T)."""
        away = self.duration / self.event_widths[1]
        density = 2.0 / (np.sqrt(2.0 * np.pi) * self.event_widths[1]) * (1.0 - self.sudden_probability)
        return self.log_likelihood - 0.5 * away**2 + np.log(density / np.ptp(self.time))

    @cached_property
    def sudden_log_density(self) -> Array:
        """Return ln of likelihood times prior density, 1/s, of each time's sudden one, (T,)."""
        with np.errstate(divide='ignore'):
            return np.diagonal(self.log_likelihood) + np.log(self.sudden_probability / np.ptp(self.time))

    @cached_property
    def log_weights(self) -> tuple[Array, Array]:
        """Return ln of each sudden event's share of p, (T,), and of each slow one's, (T, T)."""
        gap = np.diff(self.time)
        width = 0.5 * (np.r_[gap, 0.0] + np.r_[0.0, gap])
        area = np.outer(width, width)
        # Of the first cell only what is behind the start.
        area[np.diag_indices(width.size)] *= 0.5
        return self.sudden_log_density + np.log(width), self.slow_log_density + np.log(area)

    @cached_property
    def log_integral(self) -> float:
        """Return ln p over all events, nats, less the same as `likely`."""
        sudden_log_density, slow_log_density = self.log_weights
        return float(np.logaddexp.reduce(np.r_[sudden_log_density, slow_log_density.ravel()]))

    @cached_property
    def probability(self) -> tuple[Array, Array]:
        """Return the probability of each sudden event, (T,), and of each slow one, (T, T)."""
        sudden_log_density, slow_log_density = self.log_weights
        return np.exp(sudden_log_density - self.log_integral), np.exp(slow_log_density - self.log_integral)

    @property
    def refinement_times(self) -> Array:
        """Return times that have to be looked at besides, (k,)."""
        sudden_log_density, slow_log_density = self.probability
        share = sudden_log_density + slow_log_density.sum(axis=0) + slow_log_density.sum(axis=1)
        best = np.unravel_index(np.argmax(self.log_likelihood), self.log_likelihood.shape)
        size, responses = self.size_posterior(self.averaging_weights[best])[0], self.reduced_products[1:, 1:]
        own = np.diagonal(responses)
        apart = 0.5 * size**2 * (own[1:] + own[:-1] - 2.0 * np.diagonal(responses, 1))
        wanted = apart * (share[1:] + share[:-1]) > MAX_INTERPOLATION_ERROR
        return 0.5 * (self.time[1:] + self.time[:-1])[wanted]

    def _mixture(self, channel_weight: Array) -> _Mixture:
        """Return all values for events so weighted, (T, T)."""
        some = np.nonzero(channel_weight > NEGLIGIBLE_WEIGHT * channel_weight.max())
        averaging_weights, (_, response) = self.averaging_weights[some], self._background_posterior
        size, variance = self.size_posterior(averaging_weights)
        slope = averaging_weights @ response[:, 1:].T
        return _Mixture(
            channel_weight[some] / channel_weight[some].sum(), variance,
            np.column_stack([self.time[some[0]], self.duration[some], size,
                             response[:, 0] + size[:, None] * slope]),
            np.column_stack([np.zeros((size.size, 2)), np.ones(size.size), slope]))

    def estimate(self) -> Array:
        """
        Return the mean of the likelier kind, sudden or slow; the likeliest where that is less so.

        Returns
        -------
        Array
            Start, duration, size from null, all else from where it is none, (3 + z,).

        """
        sudden_log_density, slow_log_density = self.probability
        channel_weight, density = slow_log_density, self.slow_log_density
        if sudden_log_density.sum() > slow_log_density.sum():
            channel_weight = np.diag(sudden_log_density)
            density = np.where(channel_weight > 0.0, self.log_likelihood, -np.inf)
        mean, best = self._mixture(channel_weight).centre, density == density.max()
        if self.log_likelihood_of(self.averaging_weights_of(*mean[:2])) > self.log_likelihood[best].max() - MAX_MEAN_DEFICIT:
            return mean
        return self._mixture(1.0 * best).centre

    def mean_square_deviation(self, values: Array) -> Array:
        """
        Return mean products of distances from values as of `likeliest`, over all events.

        Where 95 % of all times and durations reach further than that tells, larger by so much.
        """
        sudden_log_density, slow_log_density = self.probability
        every = self._mixture(slow_log_density + np.diag(sudden_log_density))
        away = every.mean - values
        found = (away * every.channel_weight[:, None]).T @ away
        found += (every.size_slope * (every.channel_weight * every.variance)[:, None]).T @ every.size_slope
        found[3:, 3:] += self._background_posterior[0]
        wider = np.maximum(every.credible_reach(values) / (Z95 * np.sqrt(np.diagonal(found))), 1.0)
        wider[2:] = 1.0
        return np.asarray(wider[:, None] * found * wider)
