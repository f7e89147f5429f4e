"""One covariance for all hypotheses: what each leaves of a record, whitened alike."""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED, compiled
from flex_plant_sim.diagnosis.prediction.matrices import add_product, Matrices, mix
from flex_plant_sim.diagnosis.record.windows import Indices
import numpy as np


@dataclass(frozen=True)
class Common:
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

    matrices: Matrices
    output: Array

    def whitened(self, missed: Array, rows: Indices) -> Array:
        """Return y - y_h, (S, W, B, m), less what the nominal filter foresees of it."""
        return _turned(self.matrices, self.output, missed, rows, False)


def missed(matrices: Matrices, output: Array, errors: Array, rows: Indices) -> Array:
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
    return _turned(matrices, output, errors, rows, True)


def as_late(missed: Array, late: int) -> Array:
    """Return y - y_h (S, …, m) with the strain as late as it is read; its first value stays."""
    if late == 0:
        return missed
    rows = np.maximum(np.arange(len(missed)) - late, 0)
    return np.concatenate([missed[..., :2], missed[rows][..., 2:]], axis=-1)


def _turned(matrices: Matrices, output: Array, given: Array, rows: Indices, back: bool) -> Array:
    """Return errors from outputs, or (back) outputs from errors, both from zero on."""
    table = matrices.filter_table(len(output))
    if COMPILED:
        return np.asarray(_loop(matrices.weights, table.reshape(len(table), -1),
                                np.ascontiguousarray(output.T), np.ascontiguousarray(given),
                                np.ascontiguousarray(rows), back))
    found, state = np.empty_like(given), np.zeros((*given.shape[1:3], output.shape[1]))
    for k, row in enumerate(rows):
        foreseen = state @ output.T
        found[k] = given[k] + foreseen if back else given[k] - foreseen
        state = Matrices(matrices.weights[row], table).stepped(
            state, found[k] if back else given[k])
    return found


@compiled
def _loop(weights: Array, table: Array, output: Array, given: Array, rows: Indices, back: bool
          ) -> Array:
    """Do so in loops, with C' (n, m) as output and a flat table (K, (n + m) n)."""
    steps, windows, batch, m = given.shape
    n = output.shape[0]
    found, flat = np.empty(given.shape), np.empty(table.shape[1])
    both, states, after = flat.reshape(-1, n), np.empty((batch, n)), np.empty(n)
    foreseen = np.empty(m)
    for w in range(windows):
        states[:] = 0.0
        for k in range(steps):
            mix(weights[rows[k, w]], table, flat)
            for b in range(batch):
                seen, shown = given[k, w, b], found[k, w, b]
                foreseen[:] = 0.0
                add_product(states[b], output, foreseen)
                for i in range(m):
                    shown[i] = seen[i] + foreseen[i] if back else seen[i] - foreseen[i]
                after[:] = 0.0
                add_product(states[b], both[:n], after)
                add_product(shown if back else seen, both[n:], after)
                states[b] = after
    return found
