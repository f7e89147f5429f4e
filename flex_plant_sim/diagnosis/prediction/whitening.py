"""One covariance for all hypotheses: what each leaves of a record, whitened alike."""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED, compiled
from flex_plant_sim.diagnosis.prediction.scheduled_matrices import (
    add_product,
    interpolate_into,
    ScheduledMatrices,
)
from flex_plant_sim.diagnosis.record.windows import Indices
import numpy as np


@dataclass(frozen=True)
class WhiteningFilter:
    """
    The nominal filter as an operator that whitens y - y_h.

    A hypothesis h that says what a record is on average, y_h, is judged by y - y_h in one and
    the same covariance. Innovations of a filter of its own are not: those are smaller where a
    hypothesis is less moved by noise (a larger inertia, strain that comes late), true or not.
    In one covariance the truth leaves least on average, whatever that covariance is.

    Attributes
    ----------
    matrices : Matrices
        The nominal predictor's, (N, …).
    output : Array
        Its C, (m, n).

    """

    matrices: ScheduledMatrices
    output: Array

    def whitened(self, output_error: Array, rows: Indices) -> Array:
        """Return y - y_h, (S, W, B, m), less what the nominal filter foresees of it."""
        return _filtered(self.matrices, self.output, output_error, rows, False)


def output_error(matrices: ScheduledMatrices, output: Array, errors: Array, rows: Indices) -> Array:
    """
    Return y - y_h, (S, W, B, m), from a predictor's one-step errors.

    y_h is what the arm does from the windows' starts on without corrections: those are all that
    a linear predictor adds to it.

    Parameters
    ----------
    matrices : Matrices
        The predictor's, (N, …).
    output : Array
        C, (m, n).
    errors : Array
        (S, W, B, m).
    rows : Indices
        Sample of each, (S, W).

    """
    return _filtered(matrices, output, errors, rows, True)


def delay_strain(output_error: Array, late: int) -> Array:
    """Return y - y_h (S, …, m) with the strain as late as it is read; its first value stays."""
    if late == 0:
        return output_error
    rows = np.maximum(np.arange(len(output_error)) - late, 0)
    return np.concatenate([output_error[..., :2], output_error[rows][..., 2:]], axis=-1)


def _filtered(matrices: ScheduledMatrices, output: Array, given: Array, rows: Indices, inverse: bool) -> Array:
    """Return errors from outputs, or (back) outputs from errors, both from zero on."""
    table = matrices.filter_table(len(output))
    if COMPILED:
        return np.asarray(_filter_compiled(matrices.weights, table.reshape(len(table), -1),
                                np.ascontiguousarray(output.T), np.ascontiguousarray(given),
                                np.ascontiguousarray(rows), inverse))
    found, state = np.empty_like(given), np.zeros((*given.shape[1:3], output.shape[1]))
    for k, row in enumerate(rows):
        predicted = state @ output.T
        found[k] = given[k] + predicted if inverse else given[k] - predicted
        state = ScheduledMatrices(matrices.weights[row], table).step_states(
            state, found[k] if inverse else given[k])
    return found


@compiled
def _filter_compiled(weights: Array, table: Array, output: Array, given: Array, rows: Indices, inverse: bool
          ) -> Array:
    """Do so in loops, with C' (n, m) as output and a flat table (K, (n + m) n)."""
    steps, windows, batch, m = given.shape
    n = output.shape[0]
    found, flat = np.empty(given.shape), np.empty(table.shape[1])
    both, states, after = flat.reshape(-1, n), np.empty((batch, n)), np.empty(n)
    predicted = np.empty(m)
    for w in range(windows):
        states[:] = 0.0
        for k in range(steps):
            interpolate_into(weights[rows[k, w]], table, flat)
            for b in range(batch):
                seen, shown = given[k, w, b], found[k, w, b]
                predicted[:] = 0.0
                add_product(states[b], output, predicted)
                for i in range(m):
                    shown[i] = seen[i] + predicted[i] if inverse else seen[i] - predicted[i]
                after[:] = 0.0
                add_product(states[b], both[:n], after)
                add_product(shown if inverse else seen, both[n:], after)
                states[b] = after
    return found
