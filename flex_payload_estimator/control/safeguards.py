"""
Limits on what the controller sends and believes.

`CommandLimiter` stands between a computed command and the drives, `BelievedPayload` between the
estimated payload and the gain that is scheduled on it. `ObedienceWatch` tells joints that do not
do what a large command asks for.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
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
        Largest rate of change, drive's own unit/s; 0 means none.
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


class ObedienceWatch:
    """
    Tells a joint that stands still, or runs the other way, under a large command.

    So does an encoder that is stuck, inverted or exchanged with another, a drive that is off, or
    an arm against a wall. No model is asked: over the later half of a time in which the command
    was large one way, an obedient joint moves that way, or slows down.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget what was seen."""
        self._seen: tuple[deque[tuple[float, float]], ...] = (deque(), deque())
        self._way = [0, 0]

    def __call__(self, time: float, angle: Iterable[float], way: Iterable[int], span: float,
                 noise: float) -> int | None:
        """
        Return the index of a joint that does not obey, or None.

        Parameters
        ----------
        time : float
            Of the sample, s.
        angle : iterable of float
            Measured, rad, 2.
        way : iterable of int
            Sign of the command up to this sample where it was large, otherwise 0; 2.
        span : float
            Time that a large command is given to move a joint, s.
        noise : float
            What an angle may change by noise alone, rad.

        """
        for k, (now, sign) in enumerate(zip(angle, way)):
            seen = self._seen[k]
            if sign != self._way[k]:
                seen.clear()
                self._way[k] = sign
            if not sign:
                continue
            seen.append((time, sign * now))
            while len(seen) > 1 and time - seen[1][0] >= span:
                seen.popleft()
            if time - seen[0][0] >= span and _runs_on(
                    seen[0], seen[len(seen) // 2], seen[-1], noise):
                return k
        return None


def _runs_on(first: tuple[float, float], middle: tuple[float, float], last: tuple[float, float],
             noise: float) -> bool:
    """Return whether a joint, at (time, way gone), moves no way, or back and no slower."""
    early = (middle[1] - first[1]) * (last[0] - middle[0]) / (middle[0] - first[0])
    late = last[1] - middle[1]
    return late <= noise and late <= early + noise


class BelievedPayload:
    """
    The payload that the gain is scheduled on: in range, and no faster than a gripper closes.

    Parameters
    ----------
    start : float
        Payload before the first estimate, kg.
    largest : float
        Largest payload that the arm can carry, kg.

    """

    def __init__(self, start: float, largest: float):
        self._start, self.largest = start, largest
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
        step = self.largest / CLOSING_TIME * max(time - self._time, 0.0)
        if math.isfinite(estimate):
            inside = min(max(estimate, 0.0), self.largest)
            self.mass = min(max(inside, self.mass - step), self.mass + step)
            self._time = time
        return self.mass
