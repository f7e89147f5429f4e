"""Noise levels: of the sensors from the record itself, of the plant as a share of its loads."""

from __future__ import annotations

from math import comb

from flex_plant_sim.arm_model import Array
from flex_plant_sim.extended_arm import ExtendedArm
import numpy as np
from scipy.linalg import solve_discrete_are

DIFFERENCES = 5
GAIN_NODES = (0, 2, 4)


def measurement_noise(output: Array) -> Array:
    """
    Return the standard deviation of the white noise of each channel, (m,).

    From fifth differences, in which the motion of an arm sampled well above its bandwidth
    leaves nothing; the median ignores the few rows where it does.
    """
    weight = np.sqrt(sum(comb(DIFFERENCES, k)**2 for k in range(DIFFERENCES + 1)))
    spread = 1.4826 * np.median(np.abs(np.diff(output, DIFFERENCES, axis=0)), axis=0) / weight
    step = np.array([np.min(d[d > 0], initial=np.inf) for d in np.abs(np.diff(output, axis=0)).T])
    quantised = np.where(np.isfinite(step), step, 0.0) / np.sqrt(12.0)
    return np.maximum(spread, np.maximum(quantised, 1e-12))


def process_noise(arm: ExtendedArm, loads: Array, level: tuple[float, float]) -> Array:
    """
    Return the variance of the generalised force noise on each coordinate, (N,).

    Parameters
    ----------
    arm : ExtendedArm
    loads : Array
        Root-mean-square generalised force on each coordinate in the record, (N,).
    level : tuple of float
        Shares of the loads: on the joints, on the deflections.

    """
    share = np.full(arm.form.order, level[1])
    share[:2] = level[0]
    return (share * loads)**2


def steady_gain(arm: ExtendedArm, force_variance: Array, noise: Array) -> Array:
    """
    Return the steady Kalman predictor gain at every schedule node, (K, n, m).

    Riccati equations at a few nodes of cos(theta_2), quadratic in between.
    """
    n, c, nodes = arm.states, arm.output_matrix, arm.nodes
    table = arm.schedule.table.reshape(nodes.size, n, -1)
    chosen = np.linspace(0, nodes.size - 1, len(GAIN_NODES)).round().astype(int)
    gains = np.stack([_gain(table[k], c, force_variance, noise) for k in chosen])
    vandermonde = np.vander(nodes[chosen], increasing=True)
    coefficients = np.linalg.solve(vandermonde, gains.reshape(len(chosen), -1))
    interpolated = np.vander(nodes, len(chosen), increasing=True) @ coefficients
    return interpolated.reshape(nodes.size, n, c.shape[0])


def _gain(table: Array, c: Array, force_variance: Array, noise: Array) -> Array:
    n = len(table)
    f, e = table[:, :n], table[:, n + 2:]
    scale = noise[0]
    q = (e[:, :force_variance.size] * force_variance) @ e[:, :force_variance.size].T
    q = q / scale**2 + 1e-14 * np.eye(n)
    r = np.diag((noise / scale)**2)
    p = solve_discrete_are(f.T, c.T, q, r)
    return np.linalg.solve(c @ p @ c.T + r, c @ p @ f.T).T
