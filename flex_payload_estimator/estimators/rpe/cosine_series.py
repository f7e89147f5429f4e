"""A slice of the schedule at an angle: a cosine series and its derivatives."""

from __future__ import annotations

from functools import lru_cache

from flex_payload_estimator.kalman.in_place import add
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED, compiled
import numpy as np


@compiled
def _waves_by_loops(angle: float, count: int) -> Array:
    waves, once, turn = np.empty((2, count)), np.cos(angle), np.sin(angle)
    cosine, sine = 1.0, 0.0
    for k in range(count):
        waves[0, k], waves[1, k] = cosine, -k * sine
        # Rotated by the angle once more, in a sixth of the time of a cosine and a sine.
        cosine, sine = cosine * once - sine * turn, sine * once + cosine * turn
    return waves


@lru_cache
def _orders(count: int) -> Array:
    return np.arange(float(count))


def _waves_by_numpy(angle: float, count: int) -> Array:
    order, waves = _orders(count), np.empty((2, count))
    np.multiply(angle, order, waves[1])
    np.cos(waves[1], waves[0])
    np.sin(waves[1], waves[1])
    waves[1] *= -order
    return waves


# cos(k angle) and their derivatives, (2, K).
_waves = _waves_by_loops if COMPILED else _waves_by_numpy


@compiled
def _summed_by_loops(waves: Array, series: Array) -> Array:
    found, width = np.zeros((2, series.shape[1])), series.shape[1] // 3
    for k in range(len(series)):
        wave, slope = waves[0, k], waves[1, k]
        # Row by row, as the table lies in memory; for two rows BLAS would copy it first.
        for j in range(found.shape[1]):
            found[0, j] += wave * series[k, j]
        for j in range(width):
            found[1, j] += slope * series[k, j]
    return found


# The series at an angle, and below them the derivative of their first third, (2, 3 W).
_summed = _summed_by_loops if COMPILED else np.dot


@compiled
def series_at(angle: float, series: Array, mass_offset: float) -> tuple[Array, Array, Array]:
    """
    Return M and its derivatives over the angle and over the payload, each flat, (W,).

    Parameters
    ----------
    angle : float
        rad.
    series : Array
        See PayloadSlice.
    mass_offset : float
        Payload less that of the slice, kg.

    """
    width, found = series.shape[1] // 3, _summed(_waves(angle, len(series)), series)
    flat, over_m, bend = found[0][:width], found[0][width:2 * width], found[0][2 * width:]
    if mass_offset != 0.0:
        add(flat, mass_offset, over_m)
        add(flat, 0.5 * mass_offset * mass_offset, bend)
        add(over_m, mass_offset, bend)
    return flat, found[1][:width], over_m
