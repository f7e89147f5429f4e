"""The samples of late, so that a filter may learn again from where they begin."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.hypothesis import Sample
from flex_payload_estimator.estimators.rpe.sensors import Loads

Moment = tuple[Sample, Loads, float]


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

    """

    def __init__(self, most: int):
        self.most, self.first = most, 0
        self._moments: list[Moment] = []

    @property
    def end(self) -> int:
        """Return the number that the next one will have."""
        return self.first + len(self._moments)

    def __getitem__(self, number: int) -> Moment:
        """Return sample, loads then, and the time in motion that it stands for, s."""
        return self._moments[number - self.first]

    def add(self, sample: Sample, loads: Loads, lived: float) -> None:
        """Keep one; where there are twice as many as must be, the older half goes."""
        self._moments.append((sample, loads, lived))
        if len(self._moments) >= 2 * self.most:
            self.first += self.most
            del self._moments[:self.most]

    def clear(self) -> None:
        """Forget all."""
        self.first = self.end
        self._moments = []
