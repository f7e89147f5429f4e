"""
Tells joints whose angle cannot be right: against a large command, and against their tachometer.

`ObedienceWatch` needs the angle alone, `SpeedWatch` a velocity in joint_states that is measured
by another sensor.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
import math

# Longest time over which angle and velocity are compared, s: an angle that drifts by the allowed
# travel in it is told.
SPAN = 1.0
# Share by which a tachometer's constant is off: data sheets give 10 %, uncalibrated.
SHARE = 0.1
# Lag of a velocity that is filtered, or made of differences, s: two samples at 100 Hz. What the
# fastest joint travels in it is no disagreement.
LAG = 0.02
# Travel, over that one, in which the two must have agreed before the velocity is used. What is
# told k times as fast as it is agrees where |1 - k| <= 1 / PROOF + SHARE k, from 0.68 to 1.39: not
# what is always zero, or before a gear.
PROOF = 4.0
# Longest interval between two samples, over the sampling time, across which a velocity is
# integrated.
LONGEST = 3.0


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


class SpeedWatch:
    """
    Tells a joint whose angle does not go where its tachometer says.

    Neither commands nor a model are asked, so that friction, walls, loads and pushes do not
    matter. A velocity is used once it has agreed with the angle over some travel: zeros, and
    speeds before a gear, are left alone. One that is made of the angle itself always agrees.

    Parameters
    ----------
    speed : sequence of float
        Steady speed of each joint under its largest command, rad/s, 2.
    sample_time : float
        T, s.

    Attributes
    ----------
    proved : list of bool
        Whether the velocity of each joint is used, 2.

    """

    def __init__(self, speed: Sequence[float], sample_time: float):
        self._floor = [LAG * own for own in speed]
        self._longest = LONGEST * sample_time
        self.reset()

    def reset(self) -> None:
        """Forget what was seen, and that a velocity agreed."""
        self.proved = [False, False]
        self._begin()

    def _begin(self) -> None:
        # Time, angle and both integrals of the velocity, of itself and of its magnitude.
        self._seen: tuple[deque[tuple[float, float, float, float]], ...] = (deque(), deque())
        self._last: tuple[float, Sequence[float]] | None = None

    def __call__(self, time: float, angle: Sequence[float], velocity: Sequence[float],
                 ) -> tuple[int, float, float] | None:
        """
        Return a joint that disagrees, and how far its angle and its velocity went, rad; or None.

        Parameters
        ----------
        time : float
            Of the sample, s.
        angle, velocity : sequence of float
            Measured, rad and rad/s, 2; a velocity that is not finite is none.

        """
        if not all(map(math.isfinite, (*angle, *velocity))):
            return None
        if self._last is None or not 0.0 < time - self._last[0] <= self._longest:
            self._begin()
        before, self._last = self._last, (time, velocity)
        for k, seen in enumerate(self._seen):
            gone = travel = 0.0
            if seen and before is not None:
                step = 0.5 * (time - before[0])
                gone = seen[-1][2] + step * (velocity[k] + before[1][k])
                travel = seen[-1][3] + step * (abs(velocity[k]) + abs(before[1][k]))
            seen.append((time, angle[k], gone, travel))
            while time - seen[0][0] > SPAN:
                seen.popleft()
            if self._disagrees(k):
                return k, seen[-1][1] - seen[0][1], gone - seen[0][2]
        return None

    def _disagrees(self, k: int) -> bool:
        """Return whether a joint's proved velocity contradicts its angle; prove it otherwise."""
        (_, start, before, passed), (_, end, after, travel) = self._seen[k][0], self._seen[k][-1]
        moved = end - start
        allowed = self._floor[k] + SHARE * (travel - passed)
        agrees = abs(moved - (after - before)) <= allowed
        if agrees and abs(moved) >= PROOF * self._floor[k]:
            self.proved[k] = True
        return self.proved[k] and not agrees
