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
        fit, or one degree more gives another rate.

    """
    if len(angle) < FEWEST:
        return np.zeros(2), np.full(2, np.inf)
    # In lengths of the stretch, so that powers are alike.
    length = step * (len(angle) - 1)
    powers = np.vander(np.linspace(0.0, 1.0, len(angle)), DEGREE + 2, increasing=True)
    finer = np.linalg.lstsq(powers, angle, rcond=None)[0][1]
    powers = powers[:, :-1]
    found, *_ = np.linalg.lstsq(powers, angle, rcond=None)
    spread = np.sum((angle - powers @ found)**2, axis=0) / (len(angle) - DEGREE - 1)
    variance = np.linalg.inv(powers.T @ powers)[1, 1] * np.maximum(spread, noise**2)
    return found[1] / length, np.maximum(np.sqrt(variance), np.abs(found[1] - finer)) / length
