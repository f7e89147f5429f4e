"""One covariance for all hypotheses: what each leaves of a record, whitened alike."""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.prediction.passage import Matrices
from flex_plant_sim.diagnosis.prediction.scan import scan
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
        gain = self.matrices.drive[..., -len(self.output):]
        return missed - driven(self.matrices.closed, gain, missed, rows) @ self.output.T


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
        Sample of each, (S, W); none twice.

    """
    gain = matrices.drive[..., -len(output):]
    return errors + driven(matrices.closed + gain @ output, gain, errors, rows) @ output.T


def driven(matrices: Array, gain: Array, errors: Array, rows: Indices) -> Array:
    """Return states (S, W, B, n) that errors alone drive from zero on."""
    n, batch = matrices.shape[-1], errors.shape[2]
    inputs = np.zeros((len(matrices), batch, n))
    inputs[rows] = np.matmul(errors, np.swapaxes(gain[rows], 2, 3))
    return scan(matrices, inputs, np.zeros((rows.shape[1], n)), rows)


def as_late(missed: Array, late: int) -> Array:
    """Return y - y_h (S, …, m) with the strain as late as it is read; its first value stays."""
    if late == 0:
        return missed
    rows = np.maximum(np.arange(len(missed)) - late, 0)
    return np.concatenate([missed[..., :2], missed[rows][..., 2:]], axis=-1)
