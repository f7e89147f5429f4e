"""
Brings samples with jitter and gaps onto the even grid on which they were meant to be taken.

A log is resampled here before it is simulated or diagnosed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from msg_config.errors import InputError
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded

Rows = NDArray[np.int64]
# Largest distance of a stamp from its place on the grid, in sampling intervals. From 0.5 on it
# would be nearer to the place of another sample.
JITTER = 0.4
# Lost samples in a row that a cubic spline through their neighbours still interpolates: the
# fastest mode visible above the noise is sampled four times a period or more.
BRIDGED = 3
# Largest share of all samples that may be lost; more is not an accident.
LOST = 0.1
# What to do about stamps from which no order of the samples follows.
UNEVEN = 'stamp samples when they are taken, and keep the rows of one publisher'
# Least share of the samples that a record must keep for findings to apply to the whole record.
KEPT = 0.9


@dataclass(frozen=True)
class Grid:
    """
    The even grid of a record, and the place of each sample on it.

    Attributes
    ----------
    interval : float
        T, s.
    place : array of int
        Place of every kept sample on the grid, increasing from 0, (N,).
    start : float
        Time of place 0, s.
    first, last : int
        Range of the kept rows, last exclusive: the longest stretch without a long gap.
    jitter : float
        Largest distance of a stamp from its place, s.
    dropped : int
        Number of rows outside this stretch.

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
        """Return the number of places, including those of lost samples."""
        return int(self.place[-1]) + 1

    @property
    def lost(self) -> int:
        """Return the number of places without a sample."""
        return self.samples - len(self.place)

    @property
    def missing(self) -> Array:
        """Return 1 at the places without a sample, else 0, (samples,)."""
        found = np.ones(self.samples)
        found[self.place] = 0.0
        return found

    @property
    def time(self) -> Array:
        """Return the time of every place, s, from zero."""
        return np.arange(float(self.samples)) * self.interval


def even_grid(time: Array, source: str, row: Callable[[int], str] = 'row {}'.format) -> Grid:
    """
    Return the even grid that increasing times belong to.

    Parameters
    ----------
    time : Array
        s, (N,), N >= 2.
    source : str
        Name of the record, for error messages.
    row : callable
        Gives the name of row k, counted from 0.

    Raises
    ------
    InputError
        The times are not near any even grid, or too many samples are lost; names the row.

    """
    interval, usual = np.diff(time), usual_interval(time)
    steps = np.rint(interval / usual)
    if steps.min() < 1:
        k = int(np.argmax(steps < 1))
        raise InputError(f'{source}: {row(k + 1)}: time: expected {usual:.6g} s after the row '
                         f'before, at least half of it, got {interval[k]:.6g} s; {UNEVEN}')
    first, last, place = _places(steps)
    slope, start = _fit_line(place, time[first:last])
    apart = np.abs(time[first:last] - start - slope * place)
    k = first + int(np.argmax(apart))
    jitter = float(apart.max())
    if jitter > JITTER * slope:
        raise InputError(f'{source}: {row(k)}: time: expected a sample every {slope:.6g} s, at '
                         f'most {JITTER:g} of it off, got one {jitter:.3g} s off; {UNEVEN}')
    grid = Grid(slope, place, start, first, last, jitter, len(time) - (last - first))
    if grid.lost > LOST * grid.samples:
        k = first + int(np.argmax(np.diff(place) > 1))
        raise InputError(f'{source}: {row(k + 1)}: time: expected {usual:.6g} s after the row '
                         f'before, got {interval[k]:.6g} s; {grid.lost} of {grid.samples} '
                         f'samples are lost, at most {LOST:.0%} may be')
    return grid


def usual_interval(time: Array) -> float:
    """Return the interval of the even grid that most times are near; lost samples do not count."""
    interval = np.diff(time)
    # The lower median, because lost samples only lengthen intervals.
    usual = float(np.sort(interval)[(len(interval) - 1) // 2])
    # Of few intervals that jitter it is percents off. The line through their places is not, once
    # hardly an interval is rounded to a wrong number of them.
    for _ in range(2):
        if not usual > 0.0:
            break
        first, last, place = _places(np.rint(interval / usual))
        usual = _fit_line(place, time[first:last])[0] if place[-1] > 0 else usual
    return usual


def _places(steps: Array) -> tuple[int, int, Rows]:
    """Return first and last (exclusive) row of the longest stretch, and the places of its rows."""
    first, last = _longest_stretch(steps)
    return first, last, np.concatenate([[0], np.cumsum(steps[first:last - 1])]).astype(np.int64)


def _longest_stretch(steps: Array) -> tuple[int, int]:
    """Return first and last (exclusive) row of the longest stretch without a long gap."""
    breaks = np.flatnonzero(steps > BRIDGED + 1)
    edges = [0, *(breaks + 1), len(steps) + 1]
    k = int(np.argmax(np.diff(edges)))
    return int(edges[k]), int(edges[k + 1])


def _fit_line(place: Rows, time: Array) -> tuple[float, float]:
    """Return the interval, s, and the time of place 0, s, of the line through the samples."""
    if len(place) < 2:
        return float(time[-1] - time[0]) or 1.0, float(time[0])
    # An even clock needs no fit, which would only add rounding errors.
    if np.ptp(time - time[0] - (time[-1] - time[0]) / place[-1] * place) < 1e-9:
        return float(time[-1] - time[0]) / float(place[-1]), float(time[0])
    slope, start = np.polyfit(place, time - time[0], 1)
    return float(slope), float(start + time[0])


def fill_by_spline(grid: Grid, values: Array, taken: Array | None = None) -> Array:
    """
    Return measurements at every place of the grid, (samples, n), from the kept rows, (N, n).

    Received rows are moved to their places unchanged; lost ones are interpolated by a cubic
    spline. If they were `taken` elsewhere, in sampling intervals from place 0, (N,), all are.
    """
    if taken is not None:
        return _spline(taken, values, np.arange(grid.samples))
    found = np.empty((grid.samples, values.shape[1]))
    found[grid.place] = values
    missing = np.setdiff1d(np.arange(grid.samples), grid.place)
    if missing.size:
        found[missing] = _spline(grid.place, values, missing)
    return found


def _spline(x: Rows | Array, y: Array, at: Rows) -> Array:
    """
    Return the values at other places of the cubic spline through y (N, n) at x, N >= 4.

    de Boor, A Practical Guide to Splines (1978), ch. IV, not-a-knot ends. scipy.interpolate has
    the same spline, but importing it takes longer than reading the log.
    """
    h, bands = np.diff(x).astype(float), np.zeros((3, len(x) - 2))
    slope = np.diff(y, axis=0) / h[:, None]
    bands[0, 1:], bands[1], bands[2, :-1] = h[1:-1], 2.0 * (h[:-1] + h[1:]), h[1:-1]
    # Not-a-knot ends: the second derivative is extrapolated on a line into the end intervals.
    first, last = h[0] / h[1], h[-1] / h[-2]
    bands[1, [0, -1]] += [h[0] * (1.0 + first), h[-1] * (1.0 + last)]
    bands[0, 1] -= h[0] * first
    bands[2, -2] -= h[-1] * last
    inner = solve_banded((1, 1), bands, 6.0 * np.diff(slope, axis=0))
    bend = np.vstack([inner[0] + first * (inner[0] - inner[1]), inner,
                      inner[-1] + last * (inner[-1] - inner[-2])])
    k = np.clip(np.searchsorted(x, at) - 1, 0, len(h) - 1)
    t, width = (at - x[k])[:, None], h[k][:, None]
    tangent = slope[k] - width * (2.0 * bend[k] + bend[k + 1]) / 6.0
    return y[k] + t * (tangent + t * (0.5 * bend[k] + t * (bend[k + 1] - bend[k]) / (6.0 * width)))


def fill_by_line(grid: Grid, values: Array) -> Array:
    """Return commands at every place, (samples, n), with lost ones interpolated linearly."""
    places = np.arange(grid.samples)
    return np.stack([np.interp(places, grid.place, column) for column in values.T], axis=1)


def fill_by_hold(grid: Grid, values: Array, taken: Array) -> Array:
    """
    Return means, from place to place, of commands held from where they were `taken` on.

    Parameters
    ----------
    grid : Grid
        The even grid of the kept rows.
    values : Array
        Commands of the kept rows, (N, n); lost ones are interpolated linearly.
    taken : Array
        Sampling intervals from place 0, (N,).

    """
    since = np.arange(float(grid.samples + 1))
    since[grid.place] = taken
    since[0], since[-1] = min(since[0], 0.0), max(since[-1], since[-2])
    total = np.cumsum(np.diff(since)[:, None] * fill_by_line(grid, values), axis=0)
    sums = np.vstack([np.zeros(values.shape[1]), total])
    places = np.arange(grid.samples + 1)
    return np.diff(np.stack([np.interp(places, since, column) for column in sums.T], axis=1),
                   axis=0)
