"""
One covariance for all hypotheses: the residual of each is whitened by the same nominal filter.

A hypothesis h states the mean of a record, y_h, and is judged by y - y_h in one covariance. The
innovations of each hypothesis's own filter compare nothing: they are smaller where the arm is
less moved by noise (a larger inertia, strain that comes late), whether that is true or not. In
one covariance, whatever it is, the true mean leaves least on average. `Predictor` first turns
innovations into y - y_h (`output_error`) and then whitens that (`WhiteningFilter`).
"""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED, compiled
from flex_plant_sim.diagnosis.prediction.scheduled_matrices import (
    add_product,
    blend_into,
    ScheduledMatrices,
)
from flex_plant_sim.diagnosis.record.windows import Indices
import numpy as np


@dataclass(frozen=True)
class WhiteningFilter:
    """
    A predictor as the operator that turns y - y_h into innovations.

    Attributes
    ----------
    matrices : ScheduledMatrices
        Of the predictor, (N, …).
    output : Array
        Its C, (m, n).

    """

    matrices: ScheduledMatrices
    output: Array

    def whitened(self, residual: Array, rows: Indices) -> Array:
        """Return y - y_h, (S, W, B, m), less what the predictor foresees of it."""
        return _filtered(self.matrices, self.output, residual, rows, False)


def output_error(matrices: ScheduledMatrices, output: Array, errors: Array, rows: Indices
                 ) -> Array:
    """
    Return y - y_h, (S, W, B, m), from a linear predictor's one-step errors.

    y_h is the open-loop response of the arm from the windows' starts. A predictor adds to it what
    its corrections by the errors do; this inverts the predictor as a filter.

    Parameters
    ----------
    matrices : ScheduledMatrices
        Of the predictor, (N, …).
    output : Array
        C, (m, n).
    errors : Array
        (S, W, B, m).
    rows : Indices
        Sample of each, (S, W).

    """
    return _filtered(matrices, output, errors, rows, True)


def _filtered(matrices: ScheduledMatrices, output: Array, given: Array, rows: Indices,
              inverse: bool) -> Array:
    """Return innovations of outputs, or (inverse) outputs of innovations, from a state of zero."""
    matrices = matrices.filter_part(len(output))
    if COMPILED:
        return np.asarray(_filter_compiled(
            matrices.nodes, matrices.weights, matrices.flat, np.ascontiguousarray(output.T),
            np.ascontiguousarray(given), np.ascontiguousarray(rows), inverse))
    found, state = np.empty_like(given), np.zeros((*given.shape[1:3], output.shape[1]))
    for k, row in enumerate(rows):
        predicted = state @ output.T
        found[k] = given[k] + predicted if inverse else given[k] - predicted
        state = matrices.at(row).step_states(state, found[k] if inverse else given[k])
    return found


@compiled
def _filter_compiled(nodes: Indices, weights: Array, table: Array, output: Array, given: Array,
                     rows: Indices, inverse: bool) -> Array:
    """Do as `_filtered` in loops, with C' (n, m) as output and a flat table (G, (n + m) n)."""
    steps, windows, batch, m = given.shape
    n = output.shape[0]
    found, flat = np.empty(given.shape), np.empty(table.shape[1])
    both, states, after = flat.reshape(-1, n), np.empty((batch, n)), np.empty(n)
    predicted = np.empty(m)
    for w in range(windows):
        states[:] = 0.0
        for k in range(steps):
            blend_into(nodes[rows[k, w]], weights[rows[k, w]], table, flat)
            for b in range(batch):
                old, new = given[k, w, b], found[k, w, b]
                predicted[:] = 0.0
                add_product(states[b], output, predicted)
                for i in range(m):
                    new[i] = old[i] + predicted[i] if inverse else old[i] - predicted[i]
                after[:] = 0.0
                add_product(states[b], both[:n], after)
                add_product(new if inverse else old, both[n:], after)
                states[b] = after
    return found
