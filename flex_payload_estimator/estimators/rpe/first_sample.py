"""Whether the first outputs were a reading: nothing before them tells."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
import numpy as np

# A leap of so many standard deviations of a channel's noise is none of it. A difference of two
# readings has the root of two of them, so one of six channels leaps so far in 1e9 first samples.
LEAP = 9.0


class FirstSample:
    """
    The first three samples of an arm at rest, of which the first may be no reading.

    An amplifier that settles, or a driver that starts at zero, gives a first sample that the next
    ones deny. A filter that began there would take it for a bent arm that swings. Of an arm that
    moves, nothing tells a wrong first sample from the first step.

    Parameters
    ----------
    variance : Array
        The robot file's noise variance of each channel, (m,).

    """

    def __init__(self, variance: Array):
        self._leap, self._head = LEAP * np.sqrt(variance), list[Array]()

    def is_off(self, output: Array) -> bool:
        """Take a sample, (m,); tell, with the third one, whether the first was no reading."""
        if len(self._head) == 3:
            return False
        self._head.append(output)
        if len(self._head) < 3:
            return False
        first, second, third = self._head
        rests = bool((np.abs(third - second) <= self._leap).all())
        return rests and bool((np.abs(second - first) > self._leap).any())
