"""
Whether a cause is equally large throughout a record, as evidence for or against the cause.

A true cause has one size. An effect that only imitates it has the same size on average, and may
need another one in each window. `Posterior` reads the gain as evidence for something unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.likelihood.sufficient_statistics import SufficientStatistics, TEMPER
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
import numpy as np

# Standard deviation of the size over the record, as a share of it: of a true cause, the share of a
# gauge that every model may miss; of an imitation, as large as the size itself. Correlation time
# of its variation, as a share of the record: halved or doubled, the gain of a cause that is
# constant, and known to 5 to 18 % in eight windows, moves by 2 nats at most. See docs/evidence.md.
CONSTANT_SPREAD, VARYING_SPREAD = DiscrepancyModel.gauge_share, 1.0
CORRELATION_SHARE = 0.5


def window_sums(rows: Array, other: Array, windows: int) -> Array:
    """Return the products of rows (a, m, N) and another (m, N) summed in each window, (a, W)."""
    by_window = other.reshape(len(other), windows, -1)
    return np.einsum('amwl,mwl->aw', rows.reshape(len(rows), *by_window.shape), by_window)


def varying_size_gain(score: Array, information: Array, spread: float) -> float:
    """
    Return ln p(r | size varies) - ln p(r | size is constant), nats.

    The size in window w is 1 + z_w times the constant one; z is an Ornstein-Uhlenbeck process with
    standard deviation `spread` and the correlation time CORRELATION_SHARE of the record.

    Parameters
    ----------
    score : Array
        -d ln p / dz at z = 0, all else at its mean, (W,).
    information : Array
        Of z, all else integrated out, (W, W).
    spread : float
        A share of the size.

    """
    distance = np.abs(np.subtract.outer(np.arange(score.size), np.arange(score.size)))
    root = spread * np.linalg.cholesky(np.exp(-distance / (CORRELATION_SHARE * score.size)))
    eigenvalues, axes = np.linalg.eigh(root.T @ information @ root)
    gain = np.maximum(eigenvalues, 0.0)
    return 0.5 * float(np.sum((axes.T @ root.T @ score)**2 / (1.0 + gain) - np.log1p(gain)))


def varying_cause_gain(statistics: SufficientStatistics, error_scale: Array,
                       rows: tuple[Array, Array, Array], windows: int, sizes: Sequence[Array]
                       ) -> float:
    """
    Return the log Bayes factor of one of the causes varying over the record against none, nats.

    Parameters
    ----------
    statistics : SufficientStatistics
        Of the fit.
    error_scale : Array
        Factor of the errors over what the filter states, (m,).
    rows : tuple of Array
        Residual (m, N), Jacobian in the values (k, m, N) and in the parts (p, m, N).
    windows : int
        W.
    sizes : sequence of Array
        For each cause, the values that are its sizes and zero elsewhere, (k,).

    """
    residual, jacobian, part_jacobian = rows
    joint = statistics.joint_marginal(error_scale)
    weight = 1.0 / (TEMPER * error_scale[:, None]**2)
    values, deviations = np.split(joint.mean, [len(jacobian)])
    at_mean = residual + np.tensordot(values - statistics.offsets, jacobian, 1) + np.tensordot(
        deviations, part_jacobian, 1)
    found = []
    for size in sizes:
        response = np.tensordot(size, jacobian, 1)
        weighted = weight * response
        cross = np.concatenate([window_sums(jacobian, weighted, windows),
                                window_sums(part_jacobian, weighted, windows)])
        score, power = window_sums(np.stack([at_mean, response]), weighted, windows)
        information = np.diag(power) - cross.T @ joint.covariance @ cross
        found.append(varying_size_gain(score, information, VARYING_SPREAD)
                     - varying_size_gain(score, information, CONSTANT_SPREAD))
    return float(np.logaddexp.reduce(found)) - math.log(len(found))
