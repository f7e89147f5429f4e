"""Measures of agreement between a simulation and a measurement, per channel."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
import numpy as np


def fit_percent(measured: Array, simulated: Array) -> Array:
    """
    Return 100 (1 - |e| / |y - mean(y)|), %: 100 is perfect, 0 no better than the mean.

    Parameters
    ----------
    measured, simulated : Array
        (N, m).

    Returns
    -------
    Array
        Shape (m,); NaN for a channel that does not move, where the fit means nothing.

    """
    spread = np.linalg.norm(measured - measured.mean(axis=0), axis=0)
    error = np.linalg.norm(measured - simulated, axis=0)
    moving = np.ptp(measured, axis=0) > 0.0
    return np.where(moving, 100.0 * (1.0 - error / np.where(moving, spread, 1.0)), np.nan)


def rmse(measured: Array, simulated: Array) -> Array:
    """Return the root mean square error in the channels' own units, (m,)."""
    return np.sqrt(np.mean((measured - simulated)**2, axis=0))
