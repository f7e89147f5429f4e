"""Samples with jitter and gaps onto the even grid that they were meant for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from msg_config.errors import InputError
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded

Rows = NDArray[np.int64]
# A stamp nearer to another sample's place than to its own says nothing.
JITTER = 0.4
# Lost samples in a row that a cubic through their neighbours still bridges: the fastest mode
# that the noise leaves visible is sampled four times a period or more.
BRIDGED = 3
# Of all samples; more are no accident.
LOST = 0.1
# Of the samples that a record must keep for what is found in it to be of the whole record.
KEPT = 0.9


@dataclass(frozen=True)
class Grid:
    """
    Where the samples of a record belong.

    Attributes
    ----------
    interval : float
        T, s.
    place : array of int
        Number of every sample kept on the grid, increasing from 0, (N,).
    start : float
        Time of place 0, s.
    first, last : int
        The rows kept, last exclusive: the longest stretch without a long gap.
    jitter : float
        Largest distance of a stamp from its place, s.
    dropped : int
        Rows outside the stretch.

    """

    interval: float
    place: Rows
    start: float
    first: int
    last: int
    jitter: float
    dropped: int

    @property
    def samples(self) -> int:
        """Return the number of places, those of lost samples included."""
        return int(self.place[-1]) + 1

    @property
    def lost(self) -> int:
        """Return how many places no sample has."""
        return self.samples - len(self.place)

    @property
    def missing(self) -> Array:
        """Return 1 at the places that no sample has, else 0, (samples,)."""
        found = np.ones(self.samples)
        found[self.place] = 0.0
        return found

    @property
    def time(self) -> Array:
        """Return the time of every place, s, from zero."""
        return np.arange(float(self.samples)) * self.interval


def even_grid(time: Array, source: str, row: Callable[[int], str] = 'row {}'.format) -> Grid:
    """
    Return the even grid under increasing times, s, (N,), N >= 2.

    Parameters
    ----------
    time : Array
        s, (N,).
    source : str
        Named in errors.
    row : callable
        Names row k, from 0.

    Raises
    ------
    InputError
        The times are not near any even grid, or too many are lost; with the row.

    """
    interval = np.diff(time)
    # The lower median: what is lost only lengthens an interval.
    usual = float(np.sort(interval)[(len(interval) - 1) // 2])
    steps = np.rint(interval / usual)
    # Times that drift against the first guess of T would leave their places.
    off = (np.abs(interval - steps * usual) > 2.0 * JITTER * usual) & (steps <= BRIDGED + 1)
    if steps.min() < 1 or off.any():
        k = int(np.argmax((steps < 1) | off))
        raise InputError(f'{source}: {row(k + 1)}: time: expected {usual:.6g} s after the row '
                         f'before, got {interval[k]:.6g} s')
    first, last = _longest(steps)
    place = np.concatenate([[0], np.cumsum(steps[first:last - 1])]).astype(np.int64)
    slope, start = _line(place, time[first:last])
    jitter = float(np.max(np.abs(time[first:last] - start - slope * place)))
    if jitter > JITTER * slope:
        raise InputError(f'{source}: time: expected a sample every {slope:.6g} s, got some '
                         f'{jitter:.3g} s from their place')
    grid = Grid(slope, place, start, first, last, jitter, len(time) - (last - first))
    if grid.lost > LOST * grid.samples:
        k = first + int(np.argmax(np.diff(place) > 1))
        raise InputError(f'{source}: {row(k + 1)}: time: expected {usual:.6g} s after the row '
                         f'before, got {interval[k]:.6g} s; {grid.lost} of {grid.samples} '
                         'samples are lost')
    return grid


def _longest(steps: Array) -> tuple[int, int]:
    """Return first and last (exclusive) row of the longest stretch without a long gap."""
    breaks = np.flatnonzero(steps > BRIDGED + 1)
    edges = [0, *(breaks + 1), len(steps) + 1]
    k = int(np.argmax(np.diff(edges)))
    return int(edges[k]), int(edges[k + 1])


def _line(place: Rows, time: Array) -> tuple[float, float]:
    if len(place) < 2:
        return float(time[-1] - time[0]) or 1.0, float(time[0])
    # An even clock needs no fit, and keeps its own digits.
    if np.ptp(time - time[0] - (time[-1] - time[0]) / place[-1] * place) < 1e-9:
        return float(time[-1] - time[0]) / float(place[-1]), float(time[0])
    slope, start = np.polyfit(place, time - time[0], 1)
    return float(slope), float(start + time[0])


def filled(grid: Grid, values: Array) -> Array:
    """
    Return rows at every place of the grid, (samples, n), from those kept, (N, n).

    What came stays as it came, at its place; what was lost lies on a cubic spline through it.
    """
    found = np.empty((grid.samples, values.shape[1]))
    found[grid.place] = values
    missing = np.setdiff1d(np.arange(grid.samples), grid.place)
    if missing.size:
        found[missing] = _spline(grid.place, values, missing)
    return found


def _spline(x: Rows, y: Array, at: Rows) -> Array:
    """
    Return the cubic spline through y at x, (N, n), N >= 4, at other places.

    de Boor, A Practical Guide to Splines (1978), ch. IV, not-a-knot ends; scipy.interpolate has
    it, too, but its import takes longer than all that is read.
    """
    h, bands = np.diff(x).astype(float), np.zeros((3, len(x) - 2))
    slope = np.diff(y, axis=0) / h[:, None]
    bands[0, 1:], bands[1], bands[2, :-1] = h[1:-1], 2.0 * (h[:-1] + h[1:]), h[1:-1]
    # At either end the second derivative goes on along its line.
    first, last = h[0] / h[1], h[-1] / h[-2]
    bands[1, [0, -1]] += [h[0] * (1.0 + first), h[-1] * (1.0 + last)]
    bands[0, 1] -= h[0] * first
    bands[2, -2] -= h[-1] * last
    inner = solve_banded((1, 1), bands, 6.0 * np.diff(slope, axis=0))
    bend = np.vstack([inner[0] + first * (inner[0] - inner[1]), inner,
                      inner[-1] + last * (inner[-1] - inner[-2])])
    k = np.searchsorted(x, at) - 1
    t, width = (at - x[k])[:, None], h[k][:, None]
    tangent = slope[k] - width * (2.0 * bend[k] + bend[k + 1]) / 6.0
    return y[k] + t * (tangent + t * (0.5 * bend[k] + t * (bend[k + 1] - bend[k]) / (6.0 * width)))


def bridged(grid: Grid, values: Array) -> Array:
    """Return commands at every place, (samples, n): on a line where some were lost."""
    places = np.arange(grid.samples)
    return np.stack([np.interp(places, grid.place, column) for column in values.T], axis=1)
