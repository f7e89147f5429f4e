"""What a fit is worth on windows it was not fitted to, and how sure its parameters are."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.held_out.fit import Fit
import numpy as np

HELD = 1e12
ORDER = 2


def held_out(fit: Fit, whitened: bool = False) -> Array:
    """
    Return each window's log-likelihood under the fit to the other windows, nats, (W,).

    The fit is linear around its optimum, so leaving a window out needs no new simulation.
    The innovation covariance, too, comes from the other windows. Shapes (the time of an event,
    say) stay as fitted, and so does the size of an event: windows without it could not tell them.

    Parameters
    ----------
    fit : Fit
        Of a hypothesis or of the base.
    whitened : bool
        Whether residuals are freed of their own vector autoregression. What passes for model
        error is coloured, and a wrong cause that takes colour away would be credited with it; of
        a model that is far off, the slow errors are what tells, and must stay.

    """
    windows, _, channels = fit.residual.shape
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
    total, colour = np.zeros(windows), autoregression(fit.residual) if whitened else None
    for w in range(windows):
        change = np.linalg.solve(hessian - gram[w], score[w])
        shifted = fit.residual + directions @ change
        if colour is not None:
            shifted = innovations(shifted, colour)
        flat, errors = shifted.reshape(-1, channels), shifted[w]
        covariance = (flat.T @ flat - errors.T @ errors) / (len(flat) - len(errors))
        quadratic = np.sum(errors * np.linalg.solve(covariance, errors.T).T)
        total[w] = -0.5 * (quadratic + len(errors) * np.linalg.slogdet(covariance)[1])
    return total / fit.weighting.temper


def autoregression(residual: Array) -> Array:
    """Return what past samples of windows (W, length, m) tell of the next, (ORDER m, m)."""
    past, channels = _past(residual), residual.shape[-1]
    return np.asarray(np.linalg.lstsq(past.reshape(-1, ORDER * channels),
                                      residual[:, ORDER:].reshape(-1, channels), rcond=None)[0])


def innovations(residual: Array, colour: Array) -> Array:
    """Return residuals less what an autoregression foretells, (W, length - ORDER, m)."""
    return residual[:, ORDER:] - _past(residual) @ colour


def _past(residual: Array) -> Array:
    length = residual.shape[1]
    return np.concatenate([residual[:, ORDER - k:length - k] for k in range(1, ORDER + 1)],
                          axis=-1)


def spread(fit: Fit) -> Array:
    """Return the covariance of (values, nuisance), tempered for coloured residuals, (k+p, k+p)."""
    root = np.sqrt(fit.weighting.temper)
    columns = fit.weighting.white_columns(fit.directions).reshape(
        -1, fit.directions.shape[-1]) / root
    return np.linalg.inv(columns.T @ columns + np.diag(fit.precision))
