"""The steady-state Kalman predictor of an arm; `Predictor` runs one through a record."""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.riccati import settled_cost
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np
from numpy.typing import NDArray

# Nodes of cos(theta_2) at which Riccati equations are solved; a cubic interpolates between them.
# A residual is then off by 0.002 of its noise at most, with three by 0.007 (both built-in robots).
RICCATI_NODES = 4


@dataclass(frozen=True)
class SteadyFilter:
    """
    The steady-state Kalman predictor at every schedule node.

    Attributes
    ----------
    gain : Array
        Of the predictor, (K, n, m).
    whitener : Array
        L^-1, with L L' the innovation covariance, (K, m, m).

    """

    gain: Array
    whitener: Array


def steady_filter(arm: ExtendedArm, force_variance: Array, noise: Array,
                  state_variance: Array | float = 0.0) -> SteadyFilter:
    """
    Return the steady-state Kalman predictor of an arm at every schedule node.

    Riccati equations are solved at RICCATI_NODES values of cos(theta_2) and interpolated.

    Parameters
    ----------
    arm : ExtendedArm
        With its schedule and its output matrix.
    force_variance : Array
        Of white noise on the generalised forces, (N,).
    noise : Array
        Standard deviation of each output channel's noise, (m,).
    state_variance : Array or float
        That a step adds to the states besides, (n,).

    """
    n, c, nodes = arm.states, arm.output_matrix, arm.nodes
    table = arm.schedule.table.reshape(nodes.size, n, -1)
    chosen = np.linspace(0, nodes.size - 1, RICCATI_NODES).round().astype(int)
    f, e = table[chosen, :, :n], table[chosen, :, n + 2:n + 2 + force_variance.size]
    q = (e * force_variance) @ np.swapaxes(e, 1, 2) + np.diag(np.zeros(n) + state_variance)
    scaled = c / noise[:, None]
    p = predicted_covariance(f, q, scaled)
    s = scaled @ p @ scaled.T + np.eye(noise.size)
    gains = np.swapaxes(np.linalg.solve(s, scaled @ p @ np.swapaxes(f, 1, 2)), 1, 2) / noise
    whiteners = np.linalg.inv(np.linalg.cholesky(s)) / noise
    return SteadyFilter(*(_interpolated_over_nodes(nodes, chosen, values)
                          for values in (gains, whiteners)))


def _interpolated_over_nodes(nodes: Array, chosen: NDArray[np.int64], values: Array) -> Array:
    """Return the polynomial through values (c, …) at chosen nodes (c,) at all of them, (K, …)."""
    coefficients = np.linalg.solve(np.vander(nodes[chosen], increasing=True),
                                   values.reshape(chosen.size, -1))
    found = np.vander(nodes, chosen.size, increasing=True) @ coefficients
    return found.reshape(nodes.size, *values.shape[1:])


def predicted_covariance(f: Array, q: Array, c: Array) -> Array:
    """
    Return P = F (P - P C'(C P C' + I)^-1 C P) F' + Q, (…, n, n).

    Outputs are scaled to unit noise, C is (m, n).

    Raises
    ------
    LinAlgError
        No output shows a mode that does not decay.

    """
    try:
        return settled_cost(np.swapaxes(f, -1, -2) - np.eye(f.shape[-1]), c.T @ c, q)
    except FloatingPointError:
        raise np.linalg.LinAlgError('no finite prediction') from None
