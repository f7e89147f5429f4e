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
    say) stay as fitted: windows without the event could not tell them.
    """
    windows, length, channels = fit.residual.shape
    root = np.sqrt(fit.weighting.temper)
    white = fit.weighting.white(fit.residual).reshape(windows, -1) / root
    columns = (fit.weighting.whitener @ fit.directions).reshape(
        windows, white.shape[1], -1) / root
    gram = np.einsum('wmk,wml->wkl', columns, columns)
    score = np.einsum('wmk,wm->wk', columns, white)
    precision = fit.precision.copy()
    if fit.hypothesis is not None:
        precision[:len(fit.values)] *= np.where(fit.hypothesis.sizes, 1.0, HELD)
    hessian = gram.sum(axis=0) + np.diag(precision)
    total = np.zeros(windows)
    for w in range(windows):
        change = np.linalg.solve(hessian - gram[w], score[w])
        shifted = fit.residual + fit.directions @ change
        others = np.delete(shifted, w, axis=0).reshape(-1, channels)
        covariance = others.T @ others / len(others)
        errors = shifted[w]
        quadratic = np.sum(errors * np.linalg.solve(covariance, errors.T).T)
        total[w] = -0.5 * (quadratic + length * np.linalg.slogdet(covariance)[1])
    return total / fit.weighting.temper


def spread(fit: Fit) -> Array:
    """Return the covariance of (values, nuisance), tempered for coloured residuals, (k+p, k+p)."""
    root = np.sqrt(fit.weighting.temper)
    columns = (fit.weighting.whitener @ fit.directions).reshape(
        -1, fit.directions.shape[-1]) / root
    return np.linalg.inv(columns.T @ columns + np.diag(fit.precision))
