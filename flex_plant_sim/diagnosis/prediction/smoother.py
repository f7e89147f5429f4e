"""
A fixed-interval smoother for an arm with latent torques and gauge errors.

`latent_forces` prepares the system and reads the result; the loops are compiled where Numba is
installed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

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
    def samples(self) -> _Samples:
        """Return what the compiled loops take of the system."""
        own = np.eye(len(self.output))
        own[:2] = 0.0
        return _Samples(np.hstack([self.output, own]), self.known_step, self.measured, self.noise,
                        self.process_covariance, self.decay, self.walk_variance)


class Smoothed(NamedTuple):
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


def smooth(system: LatentSystem) -> Smoothed:
    """
    Return the smoothed z of a record.

    Kalman filter forward, modified Bryson-Frazier adjoint back (G. J. Bierman, International
    Journal of Control 18 (1973)): equal to the smoother of Rauch, Tung and Striebel, without
    inverses. Blocks are filtered again on the way back, so that memory does not grow with N.
    """
    count, m, d = *system.measured.shape, system.states + len(system.output)
    block = min(count, int(BLOCK_BYTES / (8 * d * (d + m))))
    samples, kept, block_starts = system.samples, _Filtered.of(block, d, m), []
    z = np.concatenate([system.initial_mean, np.zeros(m)])
    p = np.diag(system.initial_deviation**2)
    for first in range(0, count, block):
        block_starts.append((first, z.copy(), p.copy()))
        _run_forward(system, samples, first, z, p, kept)
    found = Smoothed(np.empty((count, d)), np.empty((count, m)), np.empty((count, m)))
    adjoint, information = np.zeros(d), np.zeros((d, d))
    for first, z, p in reversed(block_starts):
        if len(block_starts) > 1:
            _run_forward(system, samples, first, z, p, kept)
        _backward(first, min(first + block, count), adjoint, information, samples, kept, found)
    np.sqrt(np.maximum(found.deviation, 0.0), out=found.deviation)
    return found


class _Samples(NamedTuple):
    """
    What the loops take of a system.

    `rows` is the output matrix of z, (m, n + m); each gauge also shows its own error. For the
    others see `LatentSystem`.
    """

    rows: Array
    known_step: Array
    measured: Array
    noise: Array
    process_covariance: Array
    decay: float
    walk_variance: Array


class _Filtered(NamedTuple):
    """
    The filtered quantities of the samples of a block, kept for the backward pass.

    Mean and covariance of z before the sample, (N, d) and (N, d, d), and [F, B] after it,
    (N, n, n + 2); of each of its channels, one after the other, gain, (N, m, d), innovation and
    its variance, (N, m).
    """

    mean: Array
    covariance: Array
    transition: Array
    gain: Array
    error: Array
    variance: Array

    @classmethod
    def of(cls, count: int, d: int, m: int) -> _Filtered:
        n = d - m
        return cls(np.empty((count, d)), np.empty((count, d, d)), np.empty((count, n, n + 2)),
                   np.empty((count, m, d)), np.empty((count, m)), np.empty((count, m)))


def _run_forward(system: LatentSystem, samples: _Samples, first: int, z: Array, p: Array,
                 kept: _Filtered) -> None:
    """Filter one block; z and p become the prediction for the next block."""
    stop = min(first + len(kept.mean), len(system.measured))
    flat = system.table.reshape(len(system.table), -1)
    np.matmul(system.weights[first:stop], flat,
              out=kept.transition.reshape(len(kept.mean), -1)[:stop - first])
    _forward(first, stop, z, p, samples, kept)


@compiled
def _latent_transition(n: int, d: int, decay: float) -> Array:
    """Return the transition matrix of z without the arm's own rows, (d, d)."""
    a = np.zeros((d, d))
    a[n, n] = a[n + 1, n + 1] = 1.0
    for i in range(n + 2, d):
        a[i, i] = decay
    return a


@compiled
def _forward(first: int, stop: int, z: Array, p: Array, samples: _Samples, kept: _Filtered
             ) -> None:
    """Filter samples from first up to stop; z and p become the prediction for stop."""
    rows = samples.rows
    n, d, m = kept.transition.shape[1], len(z), len(rows)
    a = _latent_transition(n, d, samples.decay)
    for k in range(first, stop):
        at = k - first
        kept.mean[at], kept.covariance[at] = z, p
        for o in range(m):
            shared = np.dot(p, rows[o])
            variance = np.dot(rows[o], shared) + samples.noise[o]
            error = samples.measured[k, o] - np.dot(rows[o], z)
            gain = shared / variance
            for i in range(d):
                z[i] += gain[i] * error
                for j in range(d):
                    p[i, j] -= gain[i] * shared[j]
            kept.gain[at, o], kept.error[at, o], kept.variance[at, o] = gain, error, variance
        a[:n, :n + 2] = kept.transition[at]
        z[:] = np.dot(a, z)
        p[:] = np.dot(np.dot(a, p), a.T)
        p[:] = 0.5 * (p + p.T)
        z[:n] += samples.known_step[k]
        p[:n, :n] += samples.process_covariance
        for j in range(m):
            p[n + j, n + j] += samples.walk_variance[k, j]


@compiled
def _backward(first: int, stop: int, adjoint: Array, information: Array, samples: _Samples,
              kept: _Filtered, found: Smoothed) -> None:
    """
    Propagate the adjoint (d,) and its information (d, d) from stop back to first.

    Writes what is found of these samples; in place of the standard deviation its square.
    """
    rows = samples.rows
    n, d, m = kept.transition.shape[1], len(adjoint), len(rows)
    a = _latent_transition(n, d, samples.decay)
    for k in range(stop - 1, first - 1, -1):
        at = k - first
        for j in range(m):
            prior, own = samples.walk_variance[k, j], information[n + j, n + j]
            found.increment_power[k, j] = (prior * adjoint[n + j])**2 + prior - prior**2 * own
        a[:n, :n + 2] = kept.transition[at]
        adjoint[:] = np.dot(a.T, adjoint)
        information[:] = np.dot(np.dot(a.T, information), a)
        for o in range(m - 1, -1, -1):
            gain, row = kept.gain[at, o], rows[o]
            shared = np.dot(information, gain)
            both = np.dot(gain, shared) + 1.0 / kept.variance[at, o]
            along = np.dot(gain, adjoint) + kept.error[at, o] / kept.variance[at, o]
            for i in range(d):
                adjoint[i] -= row[i] * along
                for j in range(d):
                    information[i, j] += (both * row[i] * row[j] - row[i] * shared[j]
                                          - shared[i] * row[j])
        p = kept.covariance[at]
        found.mean[k] = kept.mean[at] - np.dot(p, adjoint)
        for j in range(m):
            column = p[n + j]
            found.deviation[k, j] = column[n + j] - np.dot(column, np.dot(information, column))
