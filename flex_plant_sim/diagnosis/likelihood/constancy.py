"""
Whether causes and parts are the same throughout a record, as evidence for something unknown.

A true cause has one size. An effect that only imitates it has the same size on average, and may
need another one in each window. A part that gets warm or loose changes, which no effect of the
catalogue does but for the payload. `Posterior` reads the gains as evidence for something unknown.
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
    root = spread * _correlated_root(score.size)
    eigenvalues, axes = np.linalg.eigh(root.T @ information @ root)
    gain = np.maximum(eigenvalues, 0.0)
    return 0.5 * float(np.sum((axes.T @ root.T @ score)**2 / (1.0 + gain) - np.log1p(gain)))


class PartConstancy:
    """
    How each part may vary over the windows of a record, from a fit.

    Parameters
    ----------
    statistics : SufficientStatistics
        Of the fit.
    error_scale : Array
        Factor of the errors over what the filter states, (m,).
    rows : tuple of Array
        Residual (m, N), Jacobian in the values (k, m, N) and in the parts (p, m, N).
    by_window : Array
        Products of the parts' Jacobian with itself in each window, by channel, (m, W, p, p).

    """

    def __init__(self, statistics: SufficientStatistics, error_scale: Array,
                 rows: tuple[Array, Array, Array], by_window: Array):
        _, jacobian, part_jacobian = rows
        self._joint, windows = statistics.joint_marginal(error_scale), by_window.shape[1]
        self._sizes, weight = statistics.tolerances, 1.0 / (TEMPER * error_scale**2)
        at_mean = _residual_at(self._joint.mean, statistics.offsets, rows)
        self._among = np.tensordot(weight, by_window, 1)
        others = _by_window(np.concatenate([at_mean[None], jacobian]) * weight[:, None], windows)
        self._with_others = others @ np.swapaxes(_by_window(part_jacobian, windows), 1, 2)

    def _score(self, part: int) -> tuple[Array, Array]:
        """Return score (W,) and information (W, W) of a part's variation, in tolerances."""
        size, with_others = self._sizes[part], self._with_others[:, :, part]
        cross = size * np.concatenate([with_others[:, 1:], self._among[:, :, part]], axis=1)
        power = np.diag(size**2 * self._among[:, part, part])
        return -size * with_others[:, 0], power - cross @ self._joint.covariance @ cross.T

    @property
    def gains(self) -> Array:
        """Return the log Bayes factor of each part varying by its tolerance, nats, (p,)."""
        return np.array([varying_size_gain(*self._score(part), VARYING_SPREAD)
                         for part in range(len(self._sizes))])

    def course(self, part: int) -> Array:
        """Return the likeliest variation of a part over the windows, in its unit, (W,)."""
        score, information = self._score(part)
        root = VARYING_SPREAD * _correlated_root(score.size)
        return np.asarray(self._sizes[part] * root @ np.linalg.solve(
            np.eye(score.size) + root.T @ information @ root, root.T @ score))


def window_products(rows: Array, windows: int) -> Array:
    """Return the products of rows (p, m, N) with each other, by channel, (m, W, p, p)."""
    return np.stack([each @ np.swapaxes(each, 1, 2) for channel in range(rows.shape[1])
                     for each in [_by_window(rows[:, channel:channel + 1], windows)]])


def _residual_at(mean: Array, offsets: Array, rows: tuple[Array, Array, Array]) -> Array:
    """Return the residual, (m, N), with values and parts at their posterior mean, (k + p,)."""
    residual, jacobian, part_jacobian = rows
    values, deviations = np.split(mean, [len(jacobian)])
    return np.asarray(residual + np.tensordot(values - offsets, jacobian, 1)
                      + np.tensordot(deviations, part_jacobian, 1))


def _by_window(rows: Array, windows: int) -> Array:
    """Return rows (a, m, N) in each window, (W, a, m l)."""
    length = rows.shape[2] // windows
    apart = np.moveaxis(rows.reshape(*rows.shape[:2], windows, length), 2, 0)
    return np.ascontiguousarray(apart).reshape(windows, len(rows), rows.shape[1] * length)


def _correlated_root(windows: int) -> Array:
    """Return a root of the correlation between windows, (W, W)."""
    distance = np.abs(np.subtract.outer(np.arange(windows), np.arange(windows)))
    return np.linalg.cholesky(np.exp(-distance / (CORRELATION_SHARE * windows)))


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
    _, jacobian, part_jacobian = rows
    joint = statistics.joint_marginal(error_scale)
    weight = 1.0 / (TEMPER * error_scale[:, None]**2)
    at_mean = _residual_at(joint.mean, statistics.offsets, rows)
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
