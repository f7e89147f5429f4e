"""
Discrete plant matrices over cos(theta_2): computed once at nodes, interpolated at every sample.

They lie between the continuous state space and the simulator and predictors.
"""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.arm.state_space import StateSpace, zero_order_hold
import numpy as np
from numpy.typing import ArrayLike

# Number of interpolation nodes; the interpolated matrices are then within 1e-9, relative, of the
# exact ones (test_simulation.py).
NODES = 25


def chebyshev_nodes(count: int) -> Array:
    """Return the Chebyshev points of the second kind on [-1, 1], ascending, shape (count,)."""
    return -np.cos(np.pi * np.arange(count) / (count - 1))


def barycentric_weights(x: ArrayLike, nodes: Array) -> Array:
    """
    Return the weights that interpolate a polynomial through Chebyshev nodes at x.

    Berrut and Trefethen, SIAM Review 46 (2004), (4.2) and (5.4).

    Parameters
    ----------
    x : ArrayLike
        Any shape, inside [-1, 1].
    nodes : Array
        chebyshev_nodes(count).

    Returns
    -------
    Array
        Shape x.shape + (count,); each row sums to 1.

    """
    sign = (-1.0)**np.arange(nodes.size)
    sign[[0, -1]] *= 0.5
    distance = np.asarray(x, dtype=float)[..., None] - nodes
    exact = distance == 0.0
    terms = sign / np.where(exact, 1.0, distance)
    terms = np.where(exact.any(axis=-1, keepdims=True), exact.astype(float), terms)
    return terms / terms.sum(axis=-1, keepdims=True)


@dataclass(frozen=True)
class Schedule:
    """
    F, G and E of x+ = F x + G u + E f, tabulated at nodes of c = cos(theta_2).

    Attributes
    ----------
    nodes : Array
        c, shape (K,).
    table : Array
        [F G E] at the nodes, flattened: (K, n (n + 2 + N)).
    states, forces : int
        n and N: number of states and of generalised forces.

    """

    nodes: Array
    table: Array
    states: int
    forces: int

    @classmethod
    def of(cls, plant: StateSpace, nodes: Array, step: float) -> Schedule:
        """Return the table of a plant given at the nodes, with a zero-order hold over step, s."""
        inputs = np.concatenate([plant.b, plant.e], axis=-1)
        f, g = zero_order_hold(plant.a, inputs, step)
        table = np.concatenate([f, g], axis=-1)
        return cls(nodes, table.reshape(nodes.size, -1), f.shape[-1], plant.e.shape[-1])

    def at(self, cosine: ArrayLike) -> tuple[Array, Array, Array]:
        """Return F (…, n, n), G (…, n, 2) and E (…, n, N) at c (…,)."""
        weights = barycentric_weights(cosine, self.nodes)
        n = self.states
        table = (weights @ self.table).reshape(weights.shape[:-1] + (n, n + 2 + self.forces))
        return table[..., :n], table[..., n:n + 2], table[..., n + 2:]
