"""Set-points of the two angles over time."""

from __future__ import annotations

from collections.abc import Callable
import math

from flex_plant_sim.arm.second_order import Array
from msg_config.errors import InputError
import numpy as np

SetPoints = Callable[[float], Array]


def square(amplitude: float = 0.5, period: float = 4.0, lag: float = 0.0) -> SetPoints:
    """
    Return the paper's square set-points of both angles.

    Parameters
    ----------
    amplitude : float
        rad; from +amplitude in the first half of a period to -amplitude in the second.
    period : float
        s.
    lag : float
        How much later the elbow's steps come, s.

    Raises
    ------
    InputError
        period <= 0.

    """
    _check_period(period)

    def at(time: float) -> Array:
        return amplitude * np.array([_sign(time, period), _sign(time - lag, period)])

    return at


def smooth_square(amplitude: float = 0.5, period: float = 4.0, rise: float = 1.0) -> SetPoints:
    """
    Return square set-points whose steps are fifth-order polynomials (minimum jerk).

    Parameters
    ----------
    amplitude : float
        rad.
    period : float
        s.
    rise : float
        Duration of a step, s, at most half a period.

    Raises
    ------
    InputError
        period <= 0, or rise outside (0, period/2].

    """
    _check_period(period)
    if not 0.0 < rise <= 0.5 * period:
        raise InputError(f'rise: expected a duration in (0, {0.5 * period:g}] s, got {rise:g}')

    def at(time: float) -> Array:
        since = time % (0.5 * period)
        s = min(since / rise, 1.0)
        share = s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
        before = 0.0 if time < 0.5 * period else -_sign(time, period)
        return amplitude * (before + (_sign(time, period) - before) * share) * np.ones(2)

    return at


def constant(first: float, second: float) -> SetPoints:
    """Return set-points that stay, rad."""
    values = np.array([first, second], dtype=float)
    return lambda time: values.copy()


def _sign(time: float, period: float) -> float:
    """Return the square wave, robust against rounding of time at the steps."""
    half_periods = math.floor(2.0 * time / period + 1e-9)
    return 1.0 if half_periods % 2 == 0 else -1.0


def _check_period(period: float) -> None:
    if not period > 0.0:
        raise InputError(f'period: expected a duration > 0 s, got {period:g}')
