"""
Limits on what the controller sends and believes.

`CommandLimiter` stands between a computed command and the drives, `BelievedPayload` between the
estimated payload and the gain that is scheduled on it.
"""

from __future__ import annotations

import math

from flex_plant_sim.arm.second_order import Array
import numpy as np

# Shortest time in which a gripper takes or releases the largest payload, s. One wrong message at
# 100 Hz then moves the payload by a tenth of its range at most.
CLOSING_TIME = 0.1


class CommandLimiter:
    """
    Keeps commands finite, inside a magnitude limit and inside a slew rate.

    Attributes
    ----------
    limit : float
        Largest magnitude, drive's own unit. It acts at once and takes precedence over the slew
        rate.
    slew : float
        Largest rate of change, drive's own unit/s; 0 means none. A stop does not keep to it.
    sent : Array
        The last command that was passed on, (2,).

    """

    def __init__(self, limit: float = math.inf, slew: float = 0.0):
        self.limit, self.slew = limit, slew
        self.sent: Array = np.zeros(2)

    def __call__(self, wanted: Array, time: float) -> Array:
        """
        Return the command to send, (2,); a component that is not finite keeps its last value.

        Parameters
        ----------
        wanted : Array
            The computed command, drive's own unit, (2,).
        time : float
            Since the last command, s.

        """
        step = self.slew * time if self.slew else math.inf
        sent = []
        for new, last in zip(wanted.tolist(), self.sent.tolist()):
            near = min(max(new, last - step), last + step) if math.isfinite(new) else last
            sent.append(min(max(near, -self.limit), self.limit))
        self.sent = np.array(sent)
        return self.sent

    def stop(self) -> Array:
        """Return zero, (2,), whatever was sent: a slew rate would drive on what is to stop."""
        self.sent = np.zeros(2)
        return self.sent


class BelievedPayload:
    """
    The payload that the gain is scheduled on: in range, and no faster than a gripper closes.

    Parameters
    ----------
    start : float
        Payload before the first estimate, kg.
    payload_max : float
        Largest payload that the arm can carry, kg.

    """

    def __init__(self, start: float, payload_max: float):
        self._start, self.payload_max = start, payload_max
        self.reset()

    def reset(self) -> None:
        """Go back to the start payload; the first estimate is then taken without a rate limit."""
        self.mass, self._time = self._start, -math.inf

    def __call__(self, estimate: float, time: float) -> float:
        """
        Return the payload after an estimate, kg; an estimate that is not finite changes nothing.

        Parameters
        ----------
        estimate : float
            kg.
        time : float
            Of the estimate, s.

        """
        step = self.payload_max / CLOSING_TIME * max(time - self._time, 0.0)
        if math.isfinite(estimate):
            inside = min(max(estimate, 0.0), self.payload_max)
            self.mass = min(max(inside, self.mass - step), self.mass + step)
            self._time = time
        return self.mass
