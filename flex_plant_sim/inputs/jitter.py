"""
Whether samples were taken when their stamps say, or evenly, with stamps that jitter by themselves.

A clock that stamps late leaves the samples even; a program that samples late does not. Angles that
were read late lie off their course by their rate times the delay, so that the log itself tells.
"""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.inputs.resample import Grid
from flex_plant_sim.tiny import TINY
import numpy as np

# What four neighbours say of the sample between them by a cubic, less that sample.
OFF_CUBIC = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0
# Samples in a row whose errors may go together: twice what the cubic spans. Of blocks of them, the
# standard error is that of the mean; with fewer than 30 it would not be known to an eighth.
BLOCK, LEAST_BLOCKS = 10, 30
# Standard errors from which on samples are taken to have been read when their stamps say.
SURE = 5.0


@dataclass(frozen=True)
class StampShare:
    """Share of the stamps' deviations from even that the samples have, and its standard error."""

    value: float
    error: float

    @property
    def is_sure(self) -> bool:
        """Return whether samples are not even."""
        return self.value > SURE * self.error


def stamp_share(grid: Grid, time: Array, joint: Array) -> StampShare:
    """
    Estimate by least squares which share of the stamps' deviations the samples have.

    Parameters
    ----------
    grid : Grid
        The even grid of the kept rows.
    time : Array
        Stamps of the kept rows, s, (N,).
    joint : Array
        Angles, rad, (N, 2).

    Returns
    -------
    StampShare
        Of infinite error where the angles do not tell.

    """
    late = deviations(grid, time)
    even = np.flatnonzero(grid.place[4:] - grid.place[:-4] == 4) + 2
    if len(even) < BLOCK * LEAST_BLOCKS:
        return StampShare(0.0, np.inf)
    rate = np.zeros_like(joint)
    rate[1:-1] = 0.5 * (joint[2:] - joint[:-2])
    off, expected = (_off_cubic(values)[even - 2] for values in (joint, rate * late[:, None]))
    noise = np.maximum(np.std(off, axis=0), TINY)
    off, expected = off / noise, expected / noise
    power = float(np.sum(expected**2))
    if power == 0.0:
        return StampShare(0.0, np.inf)
    share = float(np.sum(expected * off)) / power
    score = np.sum(expected * (off - share * expected), axis=1)
    blocks = np.add.reduceat(score, np.arange(0, len(score), BLOCK))
    return StampShare(share, float(np.sqrt(np.sum(blocks**2))) / power)


def deviations(grid: Grid, time: Array) -> Array:
    """Return how late the stamps of the kept rows are, in sampling intervals, (N,)."""
    return np.asarray((time - grid.start) / grid.interval - grid.place)


def _off_cubic(values: Array) -> Array:
    """Return by how much values are off the cubic through their four neighbours, (N - 4, n)."""
    return np.stack([np.convolve(column, OFF_CUBIC, 'valid') for column in values.T], axis=1)
