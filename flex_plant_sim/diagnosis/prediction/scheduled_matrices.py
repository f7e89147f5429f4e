"""
The predictor's matrices over schedule nodes, interpolated where a sample is stepped.

The matrices of all samples at once would take most of the memory of a diagnosis, and reading them
most of its time.
"""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
import numpy as np

# Largest error of an entry, as a share of its largest value; a tenth of the schedule's own error.
TRUNCATION_TOLERANCE = 1e-5
# Least eigenvalue of the weights' Gram matrix, as a share of the largest, that is no rounding: ten
# times what `eigh` errs by on ten nodes. What is left out is 2e-7 of an entry.
SEEN_POWER = 1e-14
# Samples whose matrices are held at once where many are stepped together.
BLOCK_SAMPLES = 1000


@dataclass(frozen=True)
class ScheduledMatrices:
    """
    The predictor's matrices at schedule nodes, and weights of a record's samples over them.

    Attributes
    ----------
    weights : Array
        Of each sample over the nodes, (N, K).
    table : Array
        [F - K C, G, E, K]' at the nodes, (K, n + d, n).

    """

    weights: Array
    table: Array

    @classmethod
    def reduced(cls, weights: Array, table: Array) -> ScheduledMatrices:
        """
        Return the same matrices over as few nodes as these samples need; weights sum to one.

        The first node is the mean over the samples, which keeps constant entries exactly; the
        others are leading singular vectors of the deviations from it. An elbow that turns little
        needs few, and interpolation is most of the cost of a step.
        """
        flat, count = table.reshape(len(table), -1), len(weights)
        mean, largest = (np.ones(count) @ weights / count) @ flat, np.abs(flat).max(axis=0)
        # By the nodes' Gram matrix: a QR of all samples' weights would cost as much as a pass.
        power, axes = np.linalg.eigh(weights.T @ weights)
        seen = power > SEEN_POWER * power[-1]
        axes, length = axes[:, seen], np.sqrt(power[seen])
        moved = (flat - mean) / np.where(largest > 0.0, largest, 1.0)
        left, size, right = np.linalg.svd((axes * length).T @ moved, full_matrices=False)
        basis = ((axes / length) @ left).T @ weights.T
        most = np.abs(basis).max(axis=1) * size * np.abs(right).max(axis=1)
        kept = slice(int(np.sum(np.cumsum(most[::-1])[::-1] > TRUNCATION_TOLERANCE)))
        fewer = np.ones((count, 1 + len(basis[kept])))
        fewer[:, 1:] = basis[kept].T
        return cls(fewer, np.concatenate([mean[None], size[kept, None] * right[kept] * largest]
                                         ).reshape(-1, *table.shape[1:]))

    def step_states(self, state: Array, drive: Array) -> Array:
        """Return states (N, B, n) one step later, with inputs (N, B, d)."""
        both = np.concatenate([state, drive], axis=-1)
        return np.concatenate([
            both[k:k + BLOCK_SAMPLES] @ interpolated(self.weights[k:k + BLOCK_SAMPLES], self.table)
            for k in range(0, len(both), BLOCK_SAMPLES)])

    def filter_table(self, outputs: int) -> Array:
        """Return [F - K C, K]' at the nodes, (K, n + m, n)."""
        n = self.table.shape[2]
        return np.concatenate([self.table[:, :n], self.table[:, -outputs:]], axis=1)


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
