"""
Set-points from a JointTrajectory message: splines between its points, or steps.

The controller node makes them of what it receives on topic `reference`.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.inputs.stamps import TIME_JUMP
from msg_config.errors import InputError
from msg_config.input_mapping import Channels, JOINTS
from msg_config.messages import check_finite, checked_stamp
from msg_config.time_stamp import NANOSECONDS
import numpy as np
from numpy.typing import NDArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

# Samples between two points at which a spline is checked against the joints' limits.
SAMPLES_PER_PIECE = 20


@dataclass(frozen=True)
class ReferenceTrajectory:
    """
    Set-points over time.

    Attributes
    ----------
    before : Array
        Set-points before the first time, rad, (2,).
    times : tuple of float
        s, increasing.
    points : Array
        Position, velocity and acceleration at each time, rad, rad/s, rad/s^2, (N, 3, 2).
    order : int
        Highest derivative that is continuous: 0 linear, where points give positions only; 1
        cubic, with velocities; 2 quintic, with accelerations too (as joint_trajectory_controller
        does); -1 steps.

    """

    before: Array
    times: tuple[float, ...]
    points: Array
    order: int

    def __call__(self, time: float) -> Array:
        """Return the set-points, rad, (2,), at a time, s."""
        index = bisect_right(self.times, time) - 1
        if index < 0:
            return self.before
        if self.order < 0 or index == len(self.times) - 1:
            return self.points[index][0]
        start, end = self.points[index], self.points[index + 1]
        duration = self.times[index + 1] - self.times[index]
        share = (time - self.times[index]) / duration
        return _interpolated(start, end, duration, share, self.order)

    def sampled(self, per_piece: int) -> tuple[Array, Array]:
        """
        Return times, s, (K,), and the set-points at them, rad, (K, 2).

        Parameters
        ----------
        per_piece : int
            Samples of the spline between two points; steps are sampled at their points only.

        """
        times, last = np.array(self.times), self.points[-1:, 0]
        if self.order < 0 or len(times) == 1:
            return times, self.points[:, 0]
        share = np.arange(per_piece) / per_piece
        duration = np.diff(times)
        start, end = np.moveaxis(self.points[:-1], 0, 1), np.moveaxis(self.points[1:], 0, 1)
        found = _interpolated(start[:, :, None], end[:, :, None], duration[:, None, None],
                              share[:, None], self.order)
        return (np.append(times[:-1, None] + duration[:, None] * share, times[-1]),
                np.vstack([found.reshape(-1, 2), last]))

    def check_within(self, low: Array, high: Array, sent: int) -> None:
        """
        Check that the joints can reach the set-points: the points, and what is between them.

        Parameters
        ----------
        low, high : Array
            Limits, rad, (2,).
        sent : int
            Points of the message; before them may be the set-points where it came.

        Raises
        ------
        InputError
            Quotes the first point beyond a limit, or else the first place on the way.

        """
        def beyond(angles: Array) -> NDArray[np.intp]:
            return np.flatnonzero(~((angles >= low) & (angles <= high)).all(axis=1))

        with np.errstate(all='ignore'):
            times, angles = self.sampled(SAMPLES_PER_PIECE)
        outside, points = beyond(angles), self.points[-sent:, 0]
        if not outside.size:
            return
        when = f'{times[outside[0]] - times[0]:.3g} s after the first'
        wrong = beyond(points)
        what = f'{_text(points[wrong[0]])} in points[{wrong[0]}], which passes a limit {when}' \
            if wrong.size else f'{_text(angles[outside[0]])} on the way, {when}'
        raise InputError(f'reference: points: expected {_text(low)} to {_text(high)} rad, '
                         f'got {what}')

    @classmethod
    def of(cls, message: JointTrajectory, joints: Channels, before: Array, now: float | None,
           shape: str = 'spline') -> ReferenceTrajectory:
        """
        Return the set-points of a message.

        Parameters
        ----------
        message : JointTrajectory
            Joints in any order. Times count from the header's stamp, or from `now` where the
            stamp is zero. Where the first point is ahead, splines begin at `before`, at rest, at
            the start or, if that is past, now; otherwise they are followed from now on.
        joints : Channels
            Names and units of the joints.
        before : Array
            Set-points until the first point, rad, (2,).
        now : float or None
            Time of the last measurement, s; None where none come, so that no stamp is judged by
            it.
        shape : str
            How the points are joined: spline or steps.

        Raises
        ------
        InputError
            No points, unknown joints, wrong lengths, numbers that are not finite, times that are
            negative or do not increase, or a stamp of another clock (`_origin`).

        """
        rows = joints.index(message.joint_names, 'reference: joint_names')
        if len(message.joint_names) != len(JOINTS):
            raise InputError(f'reference: joint_names: expected {", ".join(joints.names)}, '
                             f'got {", ".join(message.joint_names)}')
        if not message.points:
            raise InputError('reference: points: expected at least one, got none')
        times = [_time_from_start(point) for point in message.points]
        if times[0] < 0.0 or any(b <= a for a, b in zip(times, times[1:])):
            raise InputError('reference: points.time_from_start: expected increasing times >= 0 '
                             f's, got {times}')
        origin = _origin(message, times[-1], now)
        begin, times = max(origin, now or 0.0), [origin + time for time in times]
        points = _derivatives(message.points, rows, joints)
        if shape == 'spline' and times[0] > begin:
            at_rest = np.array([[before, (0.0, 0.0), (0.0, 0.0)]])
            times, points = [begin, *times], np.concatenate([at_rest, points])
        return cls(before, tuple(times), points,
                   _order_of(message.points) if shape == 'spline' else -1)


def _origin(message: JointTrajectory, duration: float, now: float | None) -> float:
    """
    Return when a trajectory starts, s: at the stamp of its header, or now where that is zero.

    Parameters
    ----------
    message : JointTrajectory
        Its stamp counts.
    duration : float
        Time from its start to the last point, s.
    now : float or None
        Time of the last measurement, s; None where none come.

    Raises
    ------
    InputError
        The stamp is no time, or of another clock than that of the measurements, as far as can be
        told: it is further ahead than any but a clock that is set, or all points are past (those
        joint_trajectory_controller refuses, too). One point at the start may be as far past: it is
        a step whenever it comes, and a sample always comes between.

    """
    start, most = checked_stamp(message, 'reference') / NANOSECONDS, TIME_JUMP / NANOSECONDS
    if not start:
        return now or 0.0
    late = 0.0 if duration else most
    if now is not None and not now - duration - late <= start <= now + most:
        raise InputError(
            f'reference: header.stamp: expected 0 (start now), or a start at most {most:g} s '
            f'ahead with a point that is not past, by the clock of the measurements, {now:.12g} '
            f's; got {start:.12g} s, last point {start + duration:.12g} s')
    return start


def _text(angles: Array) -> str:
    return f'[{", ".join(f"{angle:.6g}" for angle in angles)}]'


def _interpolated(start: Array, end: Array, duration: float | Array, s: float | Array, order: int
                  ) -> Array:
    """
    Return the polynomial of degree 2 order + 1 between two points, at a share s of its duration.

    Parameters
    ----------
    start, end : Array
        Position, velocity and acceleration, rad, rad/s, rad/s^2, (3, …).
    duration : float or Array
        From start to end, s.
    s : float or Array
        0 to 1.
    order : int
        Highest derivative that is met at both ends.

    """
    if order == 0:
        return start[0] + s * (end[0] - start[0])
    step = end[0] - start[0]
    v_0, v_1 = duration * start[1], duration * end[1]
    if order == 1:
        return start[0] + s * (v_0 + s * (3.0 * step - 2.0 * v_0 - v_1
                                          + s * (v_0 + v_1 - 2.0 * step)))
    a_0, a_1 = duration**2 * start[2], duration**2 * end[2]
    cubic = 10.0 * step - 6.0 * v_0 - 4.0 * v_1 - 1.5 * a_0 + 0.5 * a_1
    quartic = -15.0 * step + 8.0 * v_0 + 7.0 * v_1 + 1.5 * a_0 - a_1
    quintic = 6.0 * step - 3.0 * (v_0 + v_1) - 0.5 * (a_0 - a_1)
    return start[0] + s * (v_0 + s * (0.5 * a_0 + s * (cubic + s * (quartic + s * quintic))))


def _order_of(points: Sequence[JointTrajectoryPoint]) -> int:
    """Return the highest derivative that every point gives: 0, 1 or 2."""
    if not all(len(point.velocities) for point in points):
        return 0
    return 2 if all(len(point.accelerations) for point in points) else 1


def _time_from_start(point: JointTrajectoryPoint) -> float:
    """Return the time of a point after the trajectory's start, s."""
    offset = point.time_from_start
    return float(offset.sec + offset.nanosec / NANOSECONDS)


def _derivatives(points: Sequence[JointTrajectoryPoint], rows: list[int], joints: Channels
                 ) -> Array:
    """Return position, velocity and acceleration of points in SI, zero if absent, (N, 3, 2)."""
    found = np.zeros((len(points), 3, 2))
    found[:, 0] = joints.si(_numbers(points, 'positions', rows))
    for k, field in enumerate(('velocities', 'accelerations'), start=1):
        given = [i for i, point in enumerate(points) if len(getattr(point, field))]
        if given:
            found[given, k] = joints.rate(_numbers([points[i] for i in given], field, rows))
    return found


def _numbers(points: Sequence[Any], field: str, rows: list[int]) -> Array:
    """
    Return a field of all points, in the order of our joints, (N, 2).

    It is checked as one array, because a reference may have tens of thousands of points.
    """
    values = [getattr(point, field) for point in points]
    for each in values:
        if len(each) != len(rows):
            raise InputError(f'reference: points.{field}: expected {len(rows)} values, '
                             f'got {len(each)}')
    found = np.array(values, dtype=float)[:, rows]
    for row in found[~np.isfinite(found).all(axis=1)]:
        check_finite(row, JOINTS, f'reference: points.{field}')
    return found
