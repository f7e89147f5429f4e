"""
Finds steps of an angle that no joint makes: turns of a wrapped one, and slips of an encoder.

A whole record tells what the gate cannot know of a sample: what comes after it.
"""

from __future__ import annotations

from typing import NamedTuple

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.inputs.gate import Gate, LIKE_A_TURN, Limits, TURN
from flex_plant_sim.inputs.single_errors import SHOWN
import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.int64]


class Slip(NamedTuple):
    """A step of an angle that stays: joint (0, 1), the rows that it is between, and size, rad."""

    joint: int
    before: int
    row: int
    step: float


class AngleSteps(NamedTuple):
    """The whole turns of each angle that are none of its joint, (N, 2), and slips by row."""

    turns: Rows
    slips: list[Slip]


def angle_steps(time: Array, angle: Array, limits: Limits, interval: float) -> AngleSteps:
    """
    Return what is wrong with angles, (N, 2), that change faster than their joints can.

    Such changes cut an angle into stretches. One that is whole turns beside the last that was
    believed is wrapped; the joint's own turn is that in which most angles are in its range. One
    that is elsewhere is believed, too, where both are longer than what convinces the gate: the
    encoder slipped, or the arm was moved. All others are left to the gate.

    Parameters
    ----------
    time : Array
        s, increasing, (N,).
    angle : Array
        rad, (N, 2); what is not finite is passed over.
    limits : Limits
        Of the arm.
    interval : float
        Least time between rows, s, that a joint is given to move.

    """
    turns, slips = np.zeros(angle.shape, dtype=np.int64), []
    for joint in range(angle.shape[1]):
        # A wrapped angle is beside its range by a turn at most.
        low, high = limits.low[joint] - TURN, limits.high[joint] + TURN
        there = np.flatnonzero((angle[:, joint] >= low) & (angle[:, joint] <= high))
        own = _Angle(joint, there, time[there], angle[there, joint], limits, interval)
        stretches = own.stretches()
        if len(stretches) > 1:
            turns[:, joint], found = own.judged(stretches, len(angle))
            slips += found
    return AngleSteps(turns, sorted(slips, key=lambda slip: slip.row))


class _Angle(NamedTuple):
    """An angle at the rows that have one: joint, rows, times, s, and values, rad, (N,)."""

    joint: int
    rows: Rows
    time: Array
    angle: Array
    limits: Limits
    interval: float

    def reach(self, first: int | Rows, second: int | Rows) -> Array:
        """Return by how much the joint may have moved between two rows, rad."""
        span = np.maximum(self.time[second] - self.time[first], self.interval)
        return np.asarray(self.limits.speed[self.joint] * span + self.limits.noise)

    def stretches(self) -> list[tuple[int, int]]:
        """Return first and last (exclusive) row of each stretch without a step."""
        k = np.arange(1, len(self.angle))
        cuts = k[np.abs(np.diff(self.angle)) > self.reach(k - 1, k)]
        edges = [0, *cuts.tolist(), len(self.angle)]
        return list(zip(edges[:-1], edges[1:]))

    def judged(self, stretches: list[tuple[int, int]], count: int) -> tuple[Rows, list[Slip]]:
        """Return the turns of all rows of the record, (count,), and the slips."""
        turns, slips = np.zeros(len(self.angle), dtype=np.int64), []
        believed, last, since = np.zeros(len(self.angle), dtype=bool), -1, 0
        for first, end in stretches:
            if last >= 0:
                step, reach = self.angle[first] - self.angle[last], float(self.reach(last, first))
                whole = 0 if abs(step) <= reach else round(step / TURN)
                rest = abs(step - whole * TURN)
                if rest > (min(reach, LIKE_A_TURN) if whole else reach):
                    whole, long = 0, min(since, end - first) > Gate.CONVINCED
                    slip = self._slip(last, first) if long else 0.0
                    if abs(slip) <= SHOWN * abs(step):
                        continue
                    slips.append(Slip(self.joint, int(self.rows[last]), int(self.rows[first]),
                                      slip))
                    since = 0
                turns[first:end] = turns[last] + whole
            believed[first:end] = True
            last, since = end - 1, since + end - first
        found = np.zeros(count, dtype=np.int64)
        found[self.rows] = turns - self._own_turn(turns, turns[believed])
        return found, slips

    def _own_turn(self, turns: Rows, believed: Rows) -> int:
        """Return the turn in which most angles are in the joint's range; or else most rows."""
        low, high = self.limits.low[self.joint], self.limits.high[self.joint]

        def fits(turn: int) -> tuple[int, int]:
            angle = self.angle - TURN * (turns - turn)
            return int(((low <= angle) & (angle <= high)).sum()), int((believed == turn).sum())
        return max(np.unique(believed).tolist(), key=fits)

    def _slip(self, last: int, first: int) -> float:
        """Return by how much a step between two rows is off the motion beside it, rad."""
        rate = 0.5 * sum((self.angle[k + 1] - self.angle[k]) / (self.time[k + 1] - self.time[k])
                         for k in (last - 1, first))
        return float(self.angle[first] - self.angle[last]
                     - rate * (self.time[first] - self.time[last]))
