"""
The predictor's matrices over schedule nodes, interpolated where a sample is stepped.

The matrices of all samples at once would take most of the memory of a diagnosis, and reading them
most of its time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from flex_plant_sim.arm.schedule import barycentric_weights
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
from flex_plant_sim.diagnosis.record.windows import Indices
import numpy as np

# Spacing of the table's nodes over cos(theta_2). A line between two is off by the square of that
# times an eighth of the second derivative, which is about the entry's size: 1e-5, a tenth of the
# schedule's own error.
NODE_SPACING = 0.01
# Samples whose matrices are held at once where many are stepped together.
BLOCK_SAMPLES = 1000


@dataclass(frozen=True)
class ScheduledMatrices:
    """
    The predictor's matrices at nodes, and the nodes that a record's samples lie between.

    Attributes
    ----------
    nodes : Indices
        Of each sample, (N, q); q is even.
    weights : Array
        Of each sample over its nodes, (N, q); they sum to one.
    table : Array
        [F - K C, G, E, K]' at all nodes, (G, n + d, n).

    """

    nodes: Indices
    weights: Array
    table: Array

    @classmethod
    def along(cls, cosine: Array, share: Array, schedule_nodes: Array, tables: Array
              ) -> ScheduledMatrices:
        """
        Return the matrices at close nodes over the range that an elbow angle has in a record.

        A step then reads two of them, where a polynomial would read all of the schedule's.

        Parameters
        ----------
        cosine : Array
            cos(theta_2) at the samples, (N,).
        share : Array
            Weights of the samples over P payloads, (N, P).
        schedule_nodes : Array
            Of the polynomial, (K,).
        tables : Array
            Matrices at payloads and schedule nodes, (P, K, n + d, n).

        Raises
        ------
        LinAlgError
            An angle is not finite.

        """
        if not np.isfinite(cosine).all():
            raise np.linalg.LinAlgError('no finite prediction')
        below = np.floor(cosine / NODE_SPACING).astype(np.int64)
        place, first = cosine / NODE_SPACING - below, int(below.min())
        count, payloads = int(below.max()) - first + 2, len(tables)
        at = NODE_SPACING * (first + np.arange(count))
        table = (barycentric_weights(at, schedule_nodes)
                 @ tables.reshape(payloads, schedule_nodes.size, -1))
        sides = np.stack([1.0 - place, place], axis=-1)
        nodes = ((below - first)[:, None, None] + np.arange(0, count * payloads, count)[:, None]
                 + np.arange(2))
        return cls(nodes.reshape(len(cosine), -1),
                   (share[:, :, None] * sides[:, None]).reshape(len(cosine), -1),
                   table.reshape(-1, *tables.shape[2:]))

    def at(self, rows: Indices | slice) -> ScheduledMatrices:
        """Return the same matrices for some samples alone."""
        return ScheduledMatrices(self.nodes[rows], self.weights[rows], self.table)

    @property
    def flat(self) -> Array:
        """Return the table with one row a node, (G, (n + d) n)."""
        return self.table.reshape(len(self.table), -1)

    def interpolated(self, table: Array) -> Array:
        """Return values at the nodes, (G, …), at the samples, (N, …)."""
        flat = table.reshape(len(table), -1)
        found = sum(self.weights[:, k, None] * flat[self.nodes[:, k]]
                    for k in range(self.nodes.shape[1]))
        return np.asarray(found, dtype=float).reshape(-1, *table.shape[1:])

    def step_states(self, state: Array, drive: Array) -> Array:
        """Return states (N, B, n) one step later, with inputs (N, B, d)."""
        both = np.concatenate([state, drive], axis=-1)
        blocks = [slice(k, k + BLOCK_SAMPLES) for k in range(0, len(both), BLOCK_SAMPLES)]
        return np.concatenate([both[some] @ self.at(some).interpolated(self.table)
                               for some in blocks])

    def filter_part(self, outputs: int) -> ScheduledMatrices:
        """Return the same with [F - K C, K]' alone, (G, n + m, n)."""
        n = self.table.shape[2]
        return replace(self, table=np.concatenate(
            [self.table[:, :n], self.table[:, -outputs:]], axis=1))


def interpolated(weights: Array, table: Array) -> Array:
    """Return a table (K, …) at samples whose weights over its nodes are (…, K)."""
    flat = weights @ table.reshape(len(table), -1)
    return np.asarray(flat.reshape(weights.shape[:-1] + table.shape[1:]), dtype=float)


@compiled
def interpolate_into(weights: Array, table: Array, found: Array) -> None:
    """Write a flat table (K, M), weighted by (K,), into found, (M,)."""
    found[:] = 0.0
    add_product(weights, table, found)


@compiled
def blend_into(nodes: Indices, weights: Array, table: Array, found: Array) -> None:
    """Write the rows at nodes (q,) of a flat table (G, M), weighted by (q,), into found, (M,)."""
    for j in range(0, len(nodes), 2):
        v, w, p, q = weights[j], weights[j + 1], table[nodes[j]], table[nodes[j + 1]]
        if j == 0:
            for i in range(len(found)):
                found[i] = v * p[i] + w * q[i]
        else:
            for i in range(len(found)):
                found[i] += v * p[i] + w * q[i]


@compiled
def add_product(vector: Array, matrix: Array, found: Array) -> None:
    """
    Add a vector (r,) times a matrix (r, n) to found, (n,), row by row so that it vectorises.

    Four rows at once: found is read and written once for all of them.
    """
    first = len(vector) % 4
    for j in range(first):
        factor, row = vector[j], matrix[j]
        for i in range(len(found)):
            found[i] += factor * row[i]
    for j in range(first, len(vector), 4):
        v, w, x, y = vector[j], vector[j + 1], vector[j + 2], vector[j + 3]
        p, q, r, s = matrix[j], matrix[j + 1], matrix[j + 2], matrix[j + 3]
        for i in range(len(found)):
            found[i] += v * p[i] + w * q[i] + x * r[i] + y * s[i]
