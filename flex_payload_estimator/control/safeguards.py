"""What stands between a computed command and the drives, and between an estimate and the gain."""

from __future__ import annotations

import math

from flex_plant_sim.arm.second_order import Array
import numpy as np

# No gripper takes or lets go of the largest payload in less, s; one wrong message at 100 Hz then
# moves the payload by a tenth of its range at most.
CLOSING_TIME = 0.1


class CommandLimiter:
    """
    Lets out commands that are finite, inside the limit, and no faster than the slew.

    Attributes
    ----------
    limit : float
        Largest magnitude, drive's own unit; it acts at once and goes before the slew.
    slew : float
        Largest rate of change, drive's own unit/s; 0 sets none.
    sent : Array
        The last command let out, (2,).

    """

    def __init__(self, limit: float = math.inf, slew: float = 0.0):
        self.limit, self.slew = limit, slew
        self.sent: Array = np.zeros(2)

    def __call__(self, wanted: Array, time: float) -> Array:
        """Return the command to send a time, s, after the last one; it holds what is no number."""
        step = self.slew * time if self.slew else math.inf
        sent = []
        for new, last in zip(wanted.tolist(), self.sent.tolist()):
            near = min(max(new, last - step), last + step) if math.isfinite(new) else last
            sent.append(min(max(near, -self.limit), self.limit))
        self.sent = np.array(sent)
        return self.sent


class BelievedPayload:
    """
    The payload that the gain is scheduled on: in range, and no faster than a gripper closes.

    Parameters
    ----------
    start : float
        kg.
    largest : float
        What the arm can carry, kg.

    """

    def __init__(self, start: float, largest: float):
        self._start, self.largest = start, largest
        self.reset()

    def reset(self) -> None:
        """Begin with the start's payload; take the first estimate as it comes."""
        self.mass, self._time = self._start, -math.inf

    def __call__(self, estimate: float, time: float) -> float:
        """Return the mass after an estimate, kg, at a time, s; the last where it is no number."""
        step = self.largest / CLOSING_TIME * max(time - self._time, 0.0)
        if math.isfinite(estimate):
            inside = min(max(estimate, 0.0), self.largest)
            self.mass = min(max(inside, self.mass - step), self.mass + step)
            self._time = time
        return self.mass
