"""Whether a cause is as large in all of a record: what imitates one need not be."""

from __future__ import annotations

from collections.abc import Sequence
import math

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.likelihood.sufficient_statistics import SufficientStatistics, TEMPER
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
import numpy as np

# A cause is as large in every window, to the share of what shows that every model lacks; what only
# looks like it on average changes by as much as it is large, slowly: over so much of the record.
CONSTANT_SPREAD, VARYING_SPREAD, CORRELATION_SHARE = DiscrepancyModel.gauge_share, 1.0, 0.5


def window_sums(rows: Array, other: Array, windows: int) -> Array:
    """Return the products of rows (a, m, N) and another (m, N) in each window, (a, W)."""
    each = other.reshape(len(other), windows, -1)
    return np.einsum('amwl,mwl->aw', rows.reshape(len(rows), *each.shape), each)


def varying_size_gain(score: Array, information: Array, spread: float) -> float:
    """
    Return what p(r) gains where a size is another in each window, nats.

    It is 1 + z_w times its size in window w, with z_w ~ N(0, spread^2), an Ornstein-Uhlenbeck
    process that is correlated over SLOWLY of the record.

    Parameters
    ----------
    score : Array
        -d ln p / dz at zero, all else at its mean, (W,).
    information : Array
        Of z, all else integrated out, (W, W).
    spread : float
        A share of the size.

    """
    apart = np.abs(np.subtract.outer(np.arange(score.size), np.arange(score.size)))
    root = spread * np.linalg.cholesky(np.exp(-apart / (CORRELATION_SHARE * score.size)))
    known, axes = np.linalg.eigh(root.T @ information @ root)
    gain = np.maximum(known, 0.0)
    return 0.5 * float(np.sum((axes.T @ root.T @ score)**2 / (1.0 + gain) - np.log1p(gain)))


def varying_cause_gain(statistics: SufficientStatistics, error_scale: Array, rows: tuple[Array, Array, Array], windows: int,
           sizes: Sequence[Array]) -> float:
    """
    Return what p gains where one of the causes changes over the record, nats.

    Parameters
    ----------
    moments : Moments
        Of the fit.
    scale : Array
        By how much errors exceed what the filter states, (m,).
    rows : tuple of Array
        Residual (m, N), columns of the values (k, m, N) and of the parts (p, m, N).
    windows : int
        W.
    sizes : sequence of Array
        Of each cause what grows with it, (k,): its sizes, and zero for all other values.

    """
    residual, columns, parts = rows
    wide, weight = statistics.joint_marginal(error_scale), 1.0 / (TEMPER * error_scale[:, None]**2)
    moved, deviations = np.split(wide.mean, [len(columns)])
    left = residual + np.tensordot(moved - statistics.offsets, columns, 1) + np.tensordot(
        deviations, parts, 1)
    found = []
    for size in sizes:
        row = np.tensordot(size, columns, 1)
        own = weight * row
        shared = np.concatenate([window_sums(columns, own, windows), window_sums(parts, own, windows)])
        score, alone = window_sums(np.stack([left, row]), own, windows)
        information = np.diag(alone) - shared.T @ wide.covariance @ shared
        found.append(varying_size_gain(score, information, VARYING_SPREAD)
                     - varying_size_gain(score, information, CONSTANT_SPREAD))
    return float(np.logaddexp.reduce(found)) - math.log(len(found))
