"""Set-points of the two joint angles over time: the controller's reference w_t."""

from __future__ import annotations

from collections.abc import Callable
import math

from flex_plant_sim.arm.second_order import Array
from msg_config.errors import InputError
import numpy as np

# Time, s, to joint angles, rad, (2,).
SetPoints = Callable[[float], Array]


def square(amplitude: float = 0.5, period: float = 4.0) -> SetPoints:
    """
    Return the paper's square set-points of both angles.

    Parameters
    ----------
    amplitude : float
        rad; the set-points are +amplitude in the first half of a period, -amplitude in the second.
    period : float
        s.

    Raises
    ------
    InputError
        period is not positive.

    """
    if not period > 0.0:
        raise InputError(f'period: expected a duration > 0 s, got {period:g}')

    def at(time: float) -> Array:
        return amplitude * _sign(time, period) * np.ones(2)

    return at


def constant(first: float, second: float) -> SetPoints:
    """Return set-points that are constant, rad."""
    values = np.array([first, second], dtype=float)
    return lambda time: values.copy()


def _sign(time: float, period: float) -> float:
    """Return the sign of the square wave; rounding of time does not move its steps."""
    half_periods = math.floor(2.0 * time / period + 1e-9)
    return 1.0 if half_periods % 2 == 0 else -1.0
