"""Set-points that a JointTrajectory message gives."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from msg_config.errors import InputError
from msg_config.messages import check_finite, JOINTS, NANOSECONDS, stamp_of
import numpy as np
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint


@dataclass(frozen=True)
class Trajectory:
    """
    Set-points that hold from their times on.

    Attributes
    ----------
    before : Array
        What holds until the first time, rad, (2,).
    times : tuple of float
        s, increasing.
    points : tuple of Array
        rad, (2,) each.

    """

    before: Array
    times: tuple[float, ...]
    points: tuple[Array, ...]

    def __call__(self, time: float) -> Array:
        """Return the set-points at a time, s: rad, (2,)."""
        index = bisect_right(self.times, time) - 1
        return self.before if index < 0 else self.points[index]

    @classmethod
    def of(cls, message: JointTrajectory, before: Array, now: float) -> Trajectory:
        """
        Return the set-points of a message.

        Parameters
        ----------
        message : JointTrajectory
            Joints in any order; times count from the header's stamp, or from `now` where it
            is zero.
        before : Array
            What holds until the first point, rad, (2,).
        now : float
            s.

        Raises
        ------
        InputError
            No points, unknown joints, wrong lengths, not finite, or times that do not increase.

        """
        order = _order(message.joint_names)
        if not message.points:
            raise InputError('reference: points: expected at least one, got none')
        origin = stamp_of(message) / NANOSECONDS or now
        times = [_offset(point) for point in message.points]
        if any(b <= a for a, b in zip(times, times[1:])):
            raise InputError('reference: points.time_from_start: expected increasing times, '
                             f'got {times}')
        points = [_positions(point, order) for point in message.points]
        return cls(before, tuple(origin + time for time in times), tuple(points))


def _order(names: Sequence[str]) -> list[int]:
    if sorted(names) != sorted(JOINTS):
        raise InputError(f'reference: joint_names: expected {", ".join(JOINTS)}, '
                         f'got {", ".join(names) or "none"}')
    return [list(names).index(name) for name in JOINTS]


def _offset(point: JointTrajectoryPoint) -> float:
    offset = point.time_from_start
    return float(offset.sec + offset.nanosec / NANOSECONDS)


def _positions(point: JointTrajectoryPoint, order: list[int]) -> Array:
    if len(point.positions) != len(order):
        raise InputError(f'reference: points.positions: expected {len(order)} values, '
                         f'got {len(point.positions)}')
    positions = np.array(point.positions, dtype=float)[order]
    check_finite(positions, JOINTS, 'reference: points.positions')
    return positions
