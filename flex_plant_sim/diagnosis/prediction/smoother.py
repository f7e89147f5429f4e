"""
A fixed-interval smoother for an arm with latent torques and gauge errors.

`latent_forces` prepares the system and reads the result; the loops are compiled where Numba is
installed.
"""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
import numpy as np

# Bytes for the covariances of a block. Of several blocks each is filtered twice, however many
# there are; one that stays in the processor's cache costs least.
BLOCK_BYTES = 1e6


@dataclass(frozen=True)
class LatentSystem:
    """
    The linear system z = (x, torques, gauge errors): the arm's states and what is latent.

    x+ = F x + B tau + v + w, tau+ = tau + dtau, gamma+ = decay gamma + dgamma,
    y = C x + (0, gamma) + e.

    Attributes
    ----------
    weights : Array
        Of every sample over the schedule's nodes, (N, K).
    table : Array
        [F, B] at the nodes, (K, n, n + 2).
    known_step : Array
        v: what commands, known forces and contact add in a step, (N, n).
    output : Array
        C, (m, n).
    measured : Array
        y, (N, m).
    noise : Array
        Variance of e, (m,).
    process_covariance : Array
        Of w, (n, n).
    decay : float
        Factor of the gauge errors over one sample.
    walk_variance : Array
        Variance of dtau and of dgamma at every sample, (N, m).
    initial_mean, initial_deviation : Array
        Mean of the first x (n,) and standard deviation of the first z, (n + m,).

    """

    weights: Array
    table: Array
    known_step: Array
    output: Array
    measured: Array
    noise: Array
    process_covariance: Array
    decay: float
    walk_variance: Array
    initial_mean: Array
    initial_deviation: Array

    @property
    def states(self) -> int:
        """Return n, the number of the arm's states."""
        return self.output.shape[1]

    @property
    def rows(self) -> Array:
        """Return the output matrix of z, (m, n + m); each gauge also shows its own error."""
        m = len(self.output)
        own = np.eye(m)
        own[:2] = 0.0
        return np.hstack([self.output, own])


@dataclass(frozen=True)
class Smoothed:
    """
    The posterior of z given the whole record.

    Attributes
    ----------
    mean : Array
        Posterior mean of states, torques and gauge errors, (N, n + m).
    deviation : Array
        Posterior standard deviation of torques and gauge errors, (N, m).
    increment_power : Array
        Posterior mean square of dtau and dgamma, (N, m).

    """

    mean: Array
    deviation: Array
    increment_power: Array


def smooth(system: LatentSystem, block_bytes: float = BLOCK_BYTES) -> Smoothed:
    """
    Return the smoothed z of a record.

    Kalman filter forward, modified Bryson-Frazier adjoint back (G. J. Bierman, International
    Journal of Control 18 (1973)): equal to the smoother of Rauch, Tung and Striebel, without
    inverses. Blocks are filtered again on the way back, so that memory does not grow with N.
    """
    count, m, d = *system.measured.shape, system.states + len(system.output)
    block = min(count, int(block_bytes / (8 * d * (d + m))))
    store, block_starts = _FilterStore.of(block, d, m), []
    z = np.concatenate([system.initial_mean, np.zeros(m)])
    p = np.diag(system.initial_deviation**2)
    for first in range(0, count, block):
        block_starts.append((first, z.copy(), p.copy()))
        _run_forward(system, first, z, p, store)
    mean, deviation = np.empty((count, d)), np.empty((count, m))
    increment_power = np.empty((count, m))
    adjoint, information = np.zeros(d), np.zeros((d, d))
    for first, z, p in reversed(block_starts):
        if len(block_starts) > 1:
            _run_forward(system, first, z, p, store)
        _backward(first, min(first + block, count), adjoint, information, store.transition,
                  system.rows, system.decay, system.walk_variance, store.mean, store.covariance,
                  store.gain, store.error, store.variance, mean, deviation, increment_power)
    return Smoothed(mean, np.sqrt(np.maximum(deviation, 0.0)), increment_power)


@dataclass(frozen=True)
class _FilterStore:
    """The filtered quantities of a block, kept for the backward pass."""

    mean: Array
    covariance: Array
    gain: Array
    error: Array
    variance: Array
    transition: Array

    @classmethod
    def of(cls, count: int, d: int, m: int) -> _FilterStore:
        n = d - m
        return cls(np.empty((count, d)), np.empty((count, d, d)), np.empty((count, m, d)),
                   np.empty((count, m)), np.empty((count, m)), np.empty((count, n, n + 2)))


def _run_forward(system: LatentSystem, first: int, z: Array, p: Array, store: _FilterStore
                 ) -> None:
    """Filter one block; z and p become the prediction for the next block."""
    stop = min(first + len(store.mean), len(system.measured))
    flat = system.table.reshape(len(system.table), -1)
    np.matmul(system.weights[first:stop], flat,
              out=store.transition.reshape(len(store.mean), -1)[:stop - first])
    _forward(first, stop, z, p, store.transition, system.known_step, system.rows, system.measured,
             system.noise, system.decay, system.process_covariance, system.walk_variance,
             store.mean, store.covariance, store.gain, store.error, store.variance)


@compiled
def _latent_transition(n: int, d: int, decay: float) -> Array:
    """Return the transition matrix of z without the arm's own rows, (d, d)."""
    a = np.zeros((d, d))
    a[n, n] = a[n + 1, n + 1] = 1.0
    for i in range(n + 2, d):
        a[i, i] = decay
    return a


@compiled
def _forward(first: int, stop: int, z: Array, p: Array, transition: Array, known: Array,
             rows: Array, measured: Array, noise: Array, decay: float, process_covariance: Array,
             walk_variance: Array, means: Array, covariances: Array, gains: Array, errors: Array,
             variances: Array) -> None:
    """Filter samples from first up to stop; z and p become the prediction for stop."""
    n, d, m = transition.shape[1], len(z), len(noise)
    a = _latent_transition(n, d, decay)
    for k in range(first, stop):
        at = k - first
        means[at], covariances[at] = z, p
        for o in range(m):
            shared = np.dot(p, rows[o])
            variance = np.dot(rows[o], shared) + noise[o]
            error = measured[k, o] - np.dot(rows[o], z)
            gain = shared / variance
            for i in range(d):
                z[i] += gain[i] * error
                for j in range(d):
                    p[i, j] -= gain[i] * shared[j]
            gains[at, o], errors[at, o], variances[at, o] = gain, error, variance
        a[:n, :n + 2] = transition[at]
        z[:] = np.dot(a, z)
        p[:] = np.dot(np.dot(a, p), a.T)
        p[:] = 0.5 * (p + p.T)
        z[:n] += known[k]
        p[:n, :n] += process_covariance
        for j in range(m):
            p[n + j, n + j] += walk_variance[k, j]


@compiled
def _backward(first: int, stop: int, adjoint: Array, information: Array, transition: Array,
              rows: Array, decay: float, walk_variance: Array, means: Array, covariances: Array,
              gains: Array, errors: Array, variances: Array, smoothed: Array, deviations: Array,
              increment_power: Array) -> None:
    """Propagate the adjoint (d,) and its information (d, d) from stop back to first."""
    n, d, m = transition.shape[1], len(adjoint), rows.shape[0]
    a = _latent_transition(n, d, decay)
    for k in range(stop - 1, first - 1, -1):
        at = k - first
        for j in range(m):
            prior, own = walk_variance[k, j], information[n + j, n + j]
            increment_power[k, j] = (prior * adjoint[n + j])**2 + prior - prior**2 * own
        a[:n, :n + 2] = transition[at]
        adjoint[:] = np.dot(a.T, adjoint)
        information[:] = np.dot(np.dot(a.T, information), a)
        for o in range(m - 1, -1, -1):
            gain, row = gains[at, o], rows[o]
            shared = np.dot(information, gain)
            both = np.dot(gain, shared) + 1.0 / variances[at, o]
            along = np.dot(gain, adjoint) + errors[at, o] / variances[at, o]
            for i in range(d):
                adjoint[i] -= row[i] * along
                for j in range(d):
                    information[i, j] += (both * row[i] * row[j] - row[i] * shared[j]
                                          - shared[i] * row[j])
        p = covariances[at]
        smoothed[k] = means[at] - np.dot(p, adjoint)
        for j in range(m):
            column = p[n + j]
            deviations[k, j] = column[n + j] - np.dot(column, np.dot(information, column))
