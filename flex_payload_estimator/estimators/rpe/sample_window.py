"""The window of recent samples over which a filter may learn again."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import deque
from dataclasses import dataclass
from math import comb

from flex_payload_estimator.estimators.rpe.filter import Filter, Sample
from flex_payload_estimator.estimators.rpe.likelihood import MEMORY_SAMPLES, NOISE_RATIO
from flex_payload_estimator.estimators.rpe.sensors import Loads
from flex_plant_sim.arm.second_order import Array
import numpy as np

# Orders of the differences from which the noise is bounded: noise passes all of them, and a
# motion hardly passes one of them.
DIFFERENCE_ORDERS = (1, 2, 3)
# A motion may show so many samples late, and what is known at rest is kept so often, in samples.
# Chosen: of 30, the first samples of a motion tell too much where noise is coloured
# (benchmarks/parts_off.py, 5 %, seed 916000: 25 arms of 30 inside at 10 s, with 10 samples 27).
REST_SAMPLES, REST_SPACING = 10, 2


@dataclass(slots=True)
class StoredSample:
    """
    A sample, and what the incumbent of its time made of it.

    Attributes
    ----------
    sample : Sample
    loads : Loads
        Before the sample.
    time_in_motion : float
        By how much the sample prolongs the time in motion, s; 0 at rest.
    log_density : float
        Log-likelihood of the sample by the incumbent, nats; see Filter.log_density.
    noise_scale : Array
        The incumbent's variance of each channel's noise over that of the robot file, (m,).

    """

    sample: Sample
    loads: Loads
    time_in_motion: float
    log_density: float
    noise_scale: Array


class SampleWindow:
    """
    The last samples, numbered from the start on.

    Parameters
    ----------
    size : int
        Samples that are kept at least, once there are so many; at most twice as many.

    Attributes
    ----------
    first : int
        Number of the oldest sample that is kept.
    is_complete : bool
        Whether no sample has been dropped since the window was cleared.
    time_in_motion : float
        Time that the arm has moved since the window was cleared, s.
    rested : Filter or None
        The filter at rest after the sample `first`, if the arm was at rest until then.

    """

    def __init__(self, size: int):
        self.size, self.first, self.time_in_motion = size, 0, 0.0
        self.is_complete = True
        self.rested: Filter | None = None
        self._samples: list[StoredSample] = []
        self._dropped: list[StoredSample] = []
        self._rests: deque[tuple[int, Filter]] = deque()

    @property
    def end(self) -> int:
        """Return the number of the next sample."""
        return self.first + len(self._samples)

    def __getitem__(self, number: int) -> StoredSample:
        """Return the sample of a number."""
        return self._samples[number - self.first]

    def newest(self, count: int) -> list[StoredSample]:
        """Return the last samples, oldest first."""
        return self._samples[max(len(self._samples) - count, 0):]

    def noise_has_risen(self, f: Filter, since: float) -> bool:
        """Tell whether a filter states NOISE_RATIO times the noise variance of a time, s."""
        later = bisect_right(self._samples, since, key=lambda stored: stored.sample.time)
        then = self._samples[max(later, 1) - 1].noise_scale
        return bool((f.noise_scale > NOISE_RATIO * then).any())

    def largest_noise(self, told_variance: Array) -> Array:
        """
        Return an upper bound of the recent noise variance over that of the robot file, (m,).

        The mean square of k-th differences over that of unit noise, binomial(2k, k), which a
        motion makes larger; the smallest over k, for angles and for gauges.
        """
        recent = [stored.sample.measured for stored in self._samples[-int(MEMORY_SAMPLES):]]
        values = np.array([measured for measured in recent if measured is not None])
        orders = [k for k in DIFFERENCE_ORDERS if k < len(values)]
        if not orders:
            return np.ones(told_variance.size)
        squares = np.array([np.mean(np.diff(values, k, axis=0)**2, axis=0) / comb(2 * k, k)
                            for k in orders]) / told_variance
        kinds = [kind.mean(1).min() for kind in np.split(squares, [2], axis=1) if kind.size]
        return np.repeat(kinds, (2, told_variance.size - 2)[:len(kinds)])

    def add(self, stored: StoredSample) -> None:
        """
        Keep a sample; once there are twice as many as must be, drop the older half.

        The memory of those is freed one by one: ten thousand at once delayed an answer by 15 ms.
        """
        self._samples.append(stored)
        if self._dropped:
            self._dropped.pop()
        self.time_in_motion += stored.time_in_motion
        if len(self._samples) >= 2 * self.size:
            self.first += self.size
            self.rested, self.is_complete = None, False
            self._dropped = self._samples[:self.size]
            del self._samples[:self.size]

    def rest(self, f: Filter) -> None:
        """Take the filter at rest after the newest sample; begin where it was REST_SAMPLES ago."""
        rests, newest = self._rests, self.end - 1
        if not rests or newest - rests[-1][0] >= REST_SPACING:
            rests.append((newest, f.copy()))
        while len(rests) > 1 and newest - rests[1][0] >= REST_SAMPLES:
            rests.popleft()
        number, rested = rests[0]
        if number > self.first:
            self._drop(number - self.first)
        self.rested = rested

    def since_rest(self) -> list[StoredSample]:
        """Return the samples after that to which `rested` belongs."""
        return self._samples[1:]

    def drop_before(self, time: float) -> None:
        """Drop the samples before a time, s."""
        count = bisect_left(self._samples, time, key=lambda stored: stored.sample.time)
        if count:
            self._drop(count)

    def _drop(self, count: int) -> None:
        self._dropped = self._samples[:count]
        del self._samples[:count]
        self.first, self.rested, self.is_complete = self.first + count, None, True
        self.time_in_motion = sum(stored.time_in_motion for stored in self._samples)

    def clear(self) -> None:
        """Drop all samples."""
        self.first, self.time_in_motion, self.rested = self.end, 0.0, None
        self._rests.clear()
        self.is_complete = True
        self._samples = []
