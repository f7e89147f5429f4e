"""Events of every start and end, from the responses to sudden ones: their evidence by algebra."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.likelihood.evidence import Marginal
from flex_plant_sim.interval import Z95
import numpy as np

# Between two times whose responses are apart by q nats and that have a share of the probability,
# others are looked at until that share of q is less: as increments of the response over time are
# independent, the middle is off the line between them by q / 4.
APART = 0.3
# What is less likely by so many nats is not stated for being the mean.
WORSE = 1.0
# Less than this of the most counts for nothing.
NEGLIGIBLE = 1e-9
# As all that is stated: 95 %.
CREDIBLE = 0.95


@dataclass(frozen=True)
class _Mixture:
    """Weights of events and variances of their sizes, (E,); all values, and along the size."""

    weight: Array
    variance: Array
    mean: Array
    along: Array

    @property
    def centre(self) -> Array:
        """Return the mean over all, (3 + z,)."""
        return np.asarray(self.weight @ self.mean)

    def reach(self, values: Array) -> Array:
        """Return how far from some values 95 % of all means are, (3 + z,)."""
        away = np.abs(self.mean - values)
        order = np.argsort(away, axis=0)
        last = np.sum(np.cumsum(self.weight[order], axis=0) < CREDIBLE, axis=0)
        return np.take_along_axis(np.take_along_axis(away, order, 0), last[None], 0)[0]


@dataclass(frozen=True)
class Ramps:
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
    rows: Array
    rest: Array
    prior: Array
    slab: tuple[float, float]
    size: float
    sudden: float
    weight: Array

    @cached_property
    def _products(self) -> Array:
        every = np.concatenate([self.rest, self.rows / self.size])
        every = (every * np.sqrt(self.weight)[:, None]).reshape(len(every), -1)
        return np.asarray(every @ every.T)

    @cached_property
    def _all_else(self) -> tuple[Array, Array]:
        """Return covariance (z, z) of all else without an event, and its response (z, 1 + T)."""
        some = slice(0, len(self.rest))
        marginal = Marginal(self._products[some, some], self.prior)
        kept = np.r_[0, len(self.rest):len(self._products)]
        return marginal.covariance, -marginal.covariance @ self._products[1:len(self.rest), kept]

    @cached_property
    def left(self) -> Array:
        """Return products of residual and rows with all else integrated out, (1 + T, 1 + T)."""
        kept = np.r_[0, len(self.rest):len(self._products)]
        return self._products[np.ix_(kept, kept)] + self._products[
            kept, 1:len(self.rest)] @ self._all_else[1]

    @cached_property
    def duration(self) -> Array:
        """Return how long each takes, (T, T); negative where an end is before the start."""
        return np.asarray(self.time[None] - self.time[:, None])

    @cached_property
    def _until(self) -> Array:
        """Return integrals over time up to each, of what lies between as lines, (T, T)."""
        gap, count = np.diff(self.time), self.time.size
        found = np.zeros((count, count))
        for k in range(1, count):
            found[k] = found[k - 1]
            found[k, k - 1:k + 1] += 0.5 * gap[k - 1]
        return found

    @cached_property
    def shares(self) -> Array:
        """Return of which sudden events each event is a mean, (T, T, T): start, end, which."""
        with np.errstate(divide='ignore', invalid='ignore'):
            found = (self._until[None] - self._until[:, None]) / self.duration[..., None]
        found[np.diag_indices(self.time.size)] = np.eye(self.time.size)
        return np.asarray(found)

    def shares_of(self, start: float, duration: float) -> Array:
        """Return the same of an event between the times, (T,)."""
        if duration == 0.0:
            return self._line(start)[0]
        return (self._line(start + duration)[1] - self._line(start)[1]) / duration

    def _line(self, time: float) -> tuple[Array, Array]:
        """Return the line between neighbours at a time, and its integral up to there, (T,)."""
        k = int(np.clip(np.searchsorted(self.time, time, 'right') - 1, 0, self.time.size - 2))
        gap, late = self.time[k + 1] - self.time[k], time - self.time[k]
        at, until = np.zeros(self.time.size), self._until[k].copy()
        at[k:k + 2] = 1.0 - late / gap, late / gap
        until[k:k + 2] += late - 0.5 * late**2 / gap, 0.5 * late**2 / gap
        return at, until

    def sizes_of(self, shares: Array) -> tuple[Array, Array]:
        """Return mean and variance of the size for events of some shares, (…, T), (…) each."""
        precision = np.einsum('...k,...k', shares @ self.left[1:, 1:], shares) + self.slab[0]**-2
        return -(shares @ self.left[1:, 0]) / precision, 1.0 / precision

    def likelihood_of(self, shares: Array) -> Array:
        """Return ln p of the record for events of some shares, less one for all, (…)."""
        mean, variance = self.sizes_of(shares)
        return np.asarray(0.5 * (mean**2 / variance + np.log(variance / self.slab[0]**2)))

    @cached_property
    def likely(self) -> Array:
        """Return ln p of the record for each event less one for all, (T, T); -inf before."""
        return np.where(self.duration >= 0.0, self.likelihood_of(self.shares), -np.inf)

    @cached_property
    def slow(self) -> Array:
        """Return ln of likelihood times prior density, s^-2, of each as a slow one, (T, T)."""
        away = self.duration / self.slab[1]
        density = 2.0 / (np.sqrt(2.0 * np.pi) * self.slab[1]) * (1.0 - self.sudden)
        return self.likely - 0.5 * away**2 + np.log(density / np.ptp(self.time))

    @cached_property
    def at_once(self) -> Array:
        """Return ln of likelihood times prior density, 1/s, of each time's sudden one, (T,)."""
        with np.errstate(divide='ignore'):
            return np.diagonal(self.likely) + np.log(self.sudden / np.ptp(self.time))

    @cached_property
    def logarithms(self) -> tuple[Array, Array]:
        """Return ln of each sudden event's share of p, (T,), and of each slow one's, (T, T)."""
        gap = np.diff(self.time)
        width = 0.5 * (np.r_[gap, 0.0] + np.r_[0.0, gap])
        area = np.outer(width, width)
        # Of the first cell only what is behind the start.
        area[np.diag_indices(width.size)] *= 0.5
        return self.at_once + np.log(width), self.slow + np.log(area)

    @cached_property
    def log_mass(self) -> float:
        """Return ln p over all events, nats, less the same as `likely`."""
        at_once, slow = self.logarithms
        return float(np.logaddexp.reduce(np.r_[at_once, slow.ravel()]))

    @cached_property
    def probability(self) -> tuple[Array, Array]:
        """Return the probability of each sudden event, (T,), and of each slow one, (T, T)."""
        at_once, slow = self.logarithms
        return np.exp(at_once - self.log_mass), np.exp(slow - self.log_mass)

    @property
    def between(self) -> Array:
        """Return times that have to be looked at besides, (k,)."""
        at_once, slow = self.probability
        share = at_once + slow.sum(axis=0) + slow.sum(axis=1)
        best = np.unravel_index(np.argmax(self.likely), self.likely.shape)
        size, rows = self.sizes_of(self.shares[best])[0], self.left[1:, 1:]
        own = np.diagonal(rows)
        apart = 0.5 * size**2 * (own[1:] + own[:-1] - 2.0 * np.diagonal(rows, 1))
        wanted = apart * (share[1:] + share[:-1]) > APART
        return 0.5 * (self.time[1:] + self.time[:-1])[wanted]

    def _of(self, weight: Array) -> _Mixture:
        """Return all values for events so weighted, (T, T)."""
        some = np.nonzero(weight > NEGLIGIBLE * weight.max())
        shares, (_, response) = self.shares[some], self._all_else
        size, variance = self.sizes_of(shares)
        slope = shares @ response[:, 1:].T
        return _Mixture(
            weight[some] / weight[some].sum(), variance,
            np.column_stack([self.time[some[0]], self.duration[some], size,
                             response[:, 0] + size[:, None] * slope]),
            np.column_stack([np.zeros((size.size, 2)), np.ones(size.size), slope]))

    def likeliest(self) -> Array:
        """
        Return the mean of the likelier kind, sudden or slow; the likeliest where that is less so.

        Returns
        -------
        Array
            Start, duration, size from null, all else from where it is none, (3 + z,).

        """
        at_once, slow = self.probability
        weight, density = slow, self.slow
        if at_once.sum() > slow.sum():
            weight = np.diag(at_once)
            density = np.where(weight > 0.0, self.likely, -np.inf)
        mean, best = self._of(weight).centre, density == density.max()
        if self.likelihood_of(self.shares_of(*mean[:2])) > self.likely[best].max() - WORSE:
            return mean
        return self._of(1.0 * best).centre

    def spread(self, values: Array) -> Array:
        """
        Return mean products of distances from values as of `likeliest`, over all events.

        Where 95 % of all times and durations reach further than that tells, larger by so much.
        """
        at_once, slow = self.probability
        every = self._of(slow + np.diag(at_once))
        away = every.mean - values
        found = (away * every.weight[:, None]).T @ away
        found += (every.along * (every.weight * every.variance)[:, None]).T @ every.along
        found[3:, 3:] += self._all_else[0]
        wider = np.maximum(every.reach(values) / (Z95 * np.sqrt(np.diagonal(found))), 1.0)
        wider[2:] = 1.0
        return np.asarray(wider[:, None] * found * wider)
