"""A log cut into windows: some to fit and score on, one end locked for the figures."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.logs.log import Log
from flex_plant_sim.simulation.slowest_mode import period_samples
from flex_plant_sim.tiny import TINY
from msg_config.errors import InputError
import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.int64]

# Length of a window, in periods of the slowest mode; where a log is too short for enough windows,
# and least. With 3 in place of 5, three records keep their causes.
PERIODS, FEWEST_PERIODS = 5, 3
# Periods before a window that are not scored: in them an arm forgets that it starts in the
# nominal one's state.
WARM_UP_PERIODS = 1
# Share of the windows, at one end, that no fit sees: they judge the gain.
LOCKED_SHARE = 0.25
# Least number of windows to fit: fewer do not show by how much they disagree.
FEWEST = 4
# Share of the slowest period over which a drive's torque is averaged.
INTERVAL_SHARE = 0.1
# Periods that a log must last.
LEAST_PERIODS = WARM_UP_PERIODS + (FEWEST + 1) * FEWEST_PERIODS


def warm_up_samples(slowest: float, sample_time: float) -> int:
    """Return the samples of a warm-up, by the slowest natural frequency, rad/s."""
    return WARM_UP_PERIODS * period_samples(slowest, sample_time)


def least_duration(slowest: float, sample_time: float) -> float:
    """Return how long a log must be to be cut, s."""
    return LEAST_PERIODS * warm_up_samples(slowest, sample_time) * sample_time


@dataclass(frozen=True)
class Record:
    """
    One log as the diagnosis sees it.

    Attributes
    ----------
    name : str
    time : Array
        s, (N,).
    command : Array
        As sent, (N, 2), with the samples needed by delays in front already dropped.
    output : Array
        (theta_1, theta_2, strain…), (N, m).
    payload : float
        What the operator says the arm carries, kg.
    lost : Array, optional
        As in Log.
    misread : bool
        Whether channels look exchanged, inverted or in another unit.

    """

    name: str
    time: Array
    command: Array
    output: Array
    payload: float
    lost: Array | None = None
    misread: bool = False

    @classmethod
    def of(cls, log: Log, payload: float) -> Record:
        """Return a log as a record: time from zero, with one payload, kg."""
        return cls(log.source, log.time - log.time[0], log.command, log.output, payload, log.lost,
                   bool(log.misread))

    def thinned(self, every: int) -> Record:
        """Return one sample of every so many; commands are means until the next one kept."""
        if every == 1:
            return self
        count = len(self.time) // every
        kept = slice(None, count * every, every)
        command = self.command[:count * every].reshape(count, every, -1).mean(axis=1)
        return replace(self, time=self.time[kept], command=command, output=self.output[kept],
                       lost=None if self.lost is None else self.lost[kept])

    @property
    def measured(self) -> Array:
        """Return the output with NaN in the lost rows, (N, m)."""
        if self.lost is None:
            return self.output
        return np.where(self.lost[:, None] > 0.0, np.nan, self.output)

    @cached_property
    def output_deviation(self) -> Array:
        """Return the standard deviations of the outputs, (m,)."""
        return np.std(self.output, axis=0)


@dataclass(frozen=True)
class Windows:
    """
    Windows of equal length with a warm-up in front that is not scored.

    Attributes
    ----------
    record : Record
    starts : Indices
        First scored sample of each window, (W,).
    length, warm_up : int
        Samples.

    """

    record: Record
    starts: Indices
    length: int
    warm_up: int

    @classmethod
    def cut(cls, record: Record, slowest: float, sample_time: float, locks_first: bool = False,
            longest: int | None = None) -> tuple[Windows, Windows]:
        """
        Return the windows to work on, and the locked ones at the end or at the beginning.

        A window lasts five periods of the slowest natural frequency, rad/s; in a short log as
        little as three, so that there are enough windows; `longest`, if given, is the most, in
        samples.

        Raises
        ------
        InputError
            The log is too short.

        """
        warm_up = warm_up_samples(slowest, sample_time)
        rest = len(record.time) - warm_up
        length = min(longest or PERIODS * warm_up, rest // (FEWEST + 1))
        if length < FEWEST_PERIODS * warm_up:
            raise InputError(f'{record.name}: expected at least '
                             f'{least_duration(slowest, sample_time):.1f} s, {LEAST_PERIODS} '
                             'periods of the slowest mode, got a log of '
                             f'{len(record.time) * sample_time:.1f} s')
        count = rest // length
        starts = warm_up + length * np.arange(count, dtype=np.int64)
        locked = max(1, round(LOCKED_SHARE * count))
        parts = (starts[locked:], starts[:locked]) if locks_first \
            else (starts[:-locked], starts[-locked:])
        return cls(record, parts[0], length, warm_up), cls(record, parts[1], length, warm_up)

    @cached_property
    def interval_means(self) -> tuple[Array, Array]:
        """
        Return commands and joint speeds, rad/s, of intervals of the record, (K, 2) each.

        Averaged over a tenth of the slowest period, so that a speed is known from two angles.
        """
        record = self.record
        interval = max(1, round(INTERVAL_SHARE / WARM_UP_PERIODS * self.warm_up))
        ends = np.arange(0, len(record.time), interval)
        command = np.add.reduceat(record.command, ends, axis=0)[:-1] / interval
        turned, lasted = np.diff(record.output[ends, :2], axis=0), np.diff(record.time[ends])
        return command, turned / lasted[:, None]

    @property
    def others(self) -> slice:
        """Return the samples before windows at a record's end, or after those at its start."""
        first, stop = int(self.starts[0]), int(self.starts[-1]) + self.length
        return slice(self.warm_up, first) if first > self.warm_up \
            else slice(stop, len(self.record.time))

    def thinned(self, every: int) -> Windows:
        """Return one window of every so many, see `evenly`."""
        return self.at(evenly(self.starts.size, every))

    def at(self, chosen: Indices) -> Windows:
        """Return some of the windows alone."""
        return replace(self, starts=self.starts[chosen])

    def busiest(self, every: int) -> Indices:
        """
        Return the indices of one window of every so many, and at least three, as available.

        The first and the last are among them, as in `evenly`, and of each stretch between those
        the window in which the drives do most: a limit that is rarely met shows nowhere else.
        """
        size = self.starts.size
        groups = np.array_split(np.arange(1, max(size - 1, 1)), max(-(-size // every) - 2, 1))
        square = (self.record.command - np.mean(self.record.command, axis=0))**2
        driven = np.sum(square / np.maximum(np.mean(square, axis=0), TINY), axis=1)
        totals = np.sum(driven[self.indices[:, self.warm_up:]], axis=1)
        between = [group[np.argmax(totals[group])] for group in groups if group.size]
        return np.unique([0, *between, size - 1]).astype(np.int64)

    def with_commands_moved(self, rows: int) -> Windows:
        """Return the windows of the same record with commands that act rows earlier."""
        command = self.record.command
        earlier = command[np.minimum(np.arange(len(command)) + rows, len(command) - 1)]
        return replace(self, record=replace(self.record, command=earlier))

    @property
    def indices(self) -> Indices:
        """Return the sample numbers, warm-up first, (W, warm_up + length)."""
        return self.starts[:, None] + np.arange(-self.warm_up, self.length)


def evenly(size: int, every: int) -> Indices:
    """
    Return the indices of one item of every so many of `size`, and at least two, as available.

    The first and the last are among them: what has changed in a record shows between these.
    """
    count = min(max(-(-size // every), 2), size)
    return np.round(np.linspace(0, size - 1, count)).astype(np.int64)
