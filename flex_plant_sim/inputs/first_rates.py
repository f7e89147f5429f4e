"""Whether a log begins in motion: the joints' rates at its first row, by its angles alone."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
import numpy as np

# The angles are taken as a polynomial of this degree in time: a command that begins with the log
# gives an arm at rest an acceleration and, by the drive's lag, a jerk.
DEGREE = 3
# Share of the slowest period in which angles are about cubic in time.
SHARE = 6
# Fewest rows: a parabola through the first half of them leaves something to check it by.
FEWEST = 8
# Deviations from which a joint moves: of 156 arms that begin at rest, most with steep commands,
# none is above 7; of 355 stretches in motion 352 are above 10 (benchmarks/first_rates.py).
MOVES = 10.0


def first_rows(period: int) -> int:
    """Return of how many rows the rates are read, by the samples of the slowest period."""
    return -(-period // SHARE)


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
    found, deviations = _polynomial_rates(angle, step, noise, DEGREE)
    # One that begins with a kink is no polynomial: a degree more, or one less on the first half,
    # gives another rate then.
    others = [_polynomial_rates(angle, step, noise, DEGREE + 1)[0],
              _polynomial_rates(angle[:(len(angle) + 1) // 2], step, noise, DEGREE - 1)[0]]
    return found, np.maximum(deviations, np.max(np.abs(np.array(others) - found), axis=0))


def _polynomial_rates(angle: Array, step: float, noise: Array, degree: int
                      ) -> tuple[Array, Array]:
    """Return the rates at the first row by a polynomial, and their standard deviations, (2,)."""
    # In lengths of the stretch, so that powers are alike.
    length, more = step * (len(angle) - 1), len(angle) - degree - 1
    powers = np.vander(np.linspace(0.0, 1.0, len(angle)), degree + 1, increasing=True)
    found, *_ = np.linalg.lstsq(powers, angle, rcond=None)
    spread = np.sum((angle - powers @ found)**2, axis=0) / max(more, 1)
    variance = np.linalg.inv(powers.T @ powers)[1, 1] * np.maximum(spread, noise**2)
    return found[1] / length, np.sqrt(variance) / length
