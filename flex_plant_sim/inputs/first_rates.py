"""Whether a log begins in motion: the joints' rates at its first row, by its angles alone."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
import numpy as np

# The angles are taken as a polynomial of this degree in time: a command that begins with the log
# gives an arm at rest an acceleration and, by the drive's lag, a jerk.
DEGREE = 3
# Fewest rows: half as many again as a cubic has coefficients.
FEWEST = 6
# Standard deviations from which a rate is none of noise: one log in a million.
MOVES = 5.0


def first_rates(angle: Array, step: float, noise: Array) -> tuple[Array, Array]:
    """
    Return the rates at the first row and their standard deviations, (2,) each.

    Parameters
    ----------
    angle : Array
        The first angles, rad, (K, 2). With fewer than FEWEST nothing is known: the deviation is
        infinite.
    step : float
        Sampling interval, s.
    noise : Array
        Least standard deviations of the angles, rad, (2,); larger where the polynomial does not
        fit.

    """
    if len(angle) < FEWEST:
        return np.zeros(2), np.full(2, np.inf)
    powers = np.vander(step * np.arange(len(angle)), DEGREE + 1, increasing=True)
    found, *_ = np.linalg.lstsq(powers, angle, rcond=None)
    spread = np.sum((angle - powers @ found)**2, axis=0) / (len(angle) - DEGREE - 1)
    variance = np.linalg.inv(powers.T @ powers)[1, 1] * np.maximum(spread, noise**2)
    return found[1], np.sqrt(variance)
