"""The samples of late, so that a filter may learn again from where they begin."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from math import comb

from flex_payload_estimator.estimators.rpe.evidence import FEWEST, NOISIER
from flex_payload_estimator.estimators.rpe.hypothesis import Filter, Sample
from flex_payload_estimator.estimators.rpe.sensors import Loads
from flex_plant_sim.arm.second_order import Array
import numpy as np

# Differences of measurements that are taken for noise: noise passes all, a motion few.
ORDERS = (1, 2, 3)


@dataclass(slots=True)
class Moment:
    """
    A sample, the loads then, the time in motion that it stands for, s, and what it told.

    `gained` is the log-likelihood, as judged, of whoever gives the estimate; `noise` what that
    one then took the channels' noise for, see evidence.new_record, (m,).
    """

    sample: Sample
    loads: Loads
    lived: float
    gained: float
    noise: Array


class Past:
    """
    The last samples, numbered from the start on.

    Parameters
    ----------
    most : int
        That are kept at least, once there are as many.

    Attributes
    ----------
    first : int
        The oldest one's number.
    whole : bool
        Whether nothing has been dropped since all was forgotten.
    lived : float
        For how long the arm has moved since all was forgotten, s.
    rested : Filter or None
        What was known after that one, where the arm rested before.

    """

    def __init__(self, most: int):
        self.most, self.first, self.lived = most, 0, 0.0
        self.whole = True
        self.rested: Filter | None = None
        self._moments: list[Moment] = []
        self._forgotten: list[Moment] = []

    @property
    def end(self) -> int:
        """Return the number that the next one will have."""
        return self.first + len(self._moments)

    def __getitem__(self, number: int) -> Moment:
        """Return what is kept of a sample."""
        return self._moments[number - self.first]

    def noisier(self, f: Filter, since: float) -> bool:
        """Tell whether a filter has found far more noise than there was at a time, s."""
        later = bisect_right(self._moments, since, key=lambda moment: moment.sample.time)
        before = self._moments[max(later, 1) - 1].noise
        return bool((f.noise > NOISIER * before).any())

    def most_noise(self, told: Array) -> Array:
        """
        Return what the last samples' noise may be at most, over the told variances, (m,).

        The mean square of differences, over what unit noise has; motion is in it as well.
        """
        late = [moment.sample.measured for moment in self._moments[-int(FEWEST):]]
        values = np.array([measured for measured in late if measured is not None])
        orders = [k for k in ORDERS if k < len(values)]
        if not orders:
            return np.ones(told.size)
        squares = np.array([np.mean(np.diff(values, k, axis=0)**2, axis=0) / comb(2 * k, k)
                            for k in orders]) / told
        kinds = squares[:, :2].mean(1).min(), squares[:, 2:].mean(1).min()
        return np.repeat(kinds, (2, told.size - 2))

    def add(self, moment: Moment) -> None:
        """
        Keep one; where there are twice as many as must be, the older half goes.

        Its memory is given back one by one: ten thousand at once held an answer up by 15 ms.
        """
        self._moments.append(moment)
        if self._forgotten:
            self._forgotten.pop()
        self.lived += moment.lived
        if len(self._moments) >= 2 * self.most:
            self.first += self.most
            self.rested, self.whole = None, False
            self._forgotten = self._moments[:self.most]
            del self._moments[:self.most]

    def clear(self) -> None:
        """Forget all."""
        self.first, self.lived, self.rested, self.whole = self.end, 0.0, None, True
        self._moments = []
