"""What a fit is worth on windows it was not fitted to, and how sure its parameters are."""

from __future__ import annotations

from flex_plant_sim.arm_model import Array
from flex_plant_sim.diagnosis.fit import Fit
import numpy as np

HELD = 1e12


def held_out(fit: Fit) -> Array:
    """
    Return each window's log-likelihood under the fit to the other windows, nats, (W,).

    The fit is linear around its optimum, so leaving a window out needs no new simulation.
    The innovation covariance, too, comes from the other windows. Shapes (the time of an event,
    say) stay as fitted, and so does the size of an event: windows without it could not tell them.
    """
    windows, length, channels = fit.residual.shape
    root = np.sqrt(fit.weighting.temper)
    white = fit.weighting.white(fit.residual).reshape(windows, -1) / root
    directions = fit.directions
    columns = fit.weighting.white_columns(directions).reshape(windows, white.shape[1], -1) / root
    gram = np.swapaxes(columns, 1, 2) @ columns
    score = (white[:, None] @ columns)[:, 0]
    precision = fit.precision.copy()
    if fit.hypothesis is not None:
        kept = np.logical_or(np.logical_not(fit.hypothesis.sizes), fit.hypothesis.is_event)
        precision[:len(fit.values)] *= np.where(kept, HELD, 1.0)
    hessian = gram.sum(axis=0) + np.diag(precision)
    total = np.zeros(windows)
    for w in range(windows):
        change = np.linalg.solve(hessian - gram[w], score[w])
        shifted = fit.residual + directions @ change
        flat, errors = shifted.reshape(-1, channels), shifted[w]
        covariance = (flat.T @ flat - errors.T @ errors) / (len(flat) - length)
        quadratic = np.sum(errors * np.linalg.solve(covariance, errors.T).T)
        total[w] = -0.5 * (quadratic + length * np.linalg.slogdet(covariance)[1])
    return total / fit.weighting.temper


def spread(fit: Fit) -> Array:
    """Return the covariance of (values, nuisance), tempered for coloured residuals, (k+p, k+p)."""
    root = np.sqrt(fit.weighting.temper)
    columns = fit.weighting.white_columns(fit.directions).reshape(
        -1, fit.directions.shape[-1]) / root
    return np.linalg.inv(columns.T @ columns + np.diag(fit.precision))
