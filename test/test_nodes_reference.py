"""Set-points that a JointTrajectory gives."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TYPE_CHECKING

from node_bench import Bench, JOINTS
import numpy as np
import pytest

if TYPE_CHECKING:
    from rclpy.context import Context
    from ros_loop import RosLoop

pytestmark = pytest.mark.ros


@pytest.fixture
def loop(ros_context: Context) -> Iterator[RosLoop]:
    """Return an executor in a ROS domain of its own."""
    from ros_loop import RosLoop

    loop = RosLoop(ros_context)
    yield loop
    loop.close()


def trajectory(names: Any, *points: tuple[float, Any], stamp: int = 0) -> Any:
    """Return a JointTrajectory of (time, positions)."""
    from builtin_interfaces.msg import Duration
    from msg_config.messages import time_message
    from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

    message = JointTrajectory(joint_names=list(names))
    message.header.stamp = time_message(stamp)
    for time, positions in points:
        whole, rest = divmod(round(time * 1e9), 10**9)
        message.points.append(JointTrajectoryPoint(
            positions=positions, time_from_start=Duration(sec=whole, nanosec=rest)))
    return message


def test_a_trajectory_s_points_hold_from_their_times_on() -> None:
    from flex_payload_estimator.control.trajectory import Trajectory

    points = Trajectory.of(trajectory(JOINTS[::-1], (1.0, [0.2, 0.1]), (2.0, [0.4, 0.3])),
                           np.array([9.0, 8.0]), 5.0)
    for time, wanted in ((5.9, [9.0, 8.0]), (6.0, [0.1, 0.2]), (6.9, [0.1, 0.2]),
                         (7.0, [0.3, 0.4]), (99.0, [0.3, 0.4])):
        assert points(time).tolist() == wanted
    stamped = Trajectory.of(trajectory(JOINTS, (0.0, [1.0, 2.0]), stamp=3 * 10**9),
                            np.zeros(2), 5.0)
    assert stamped(2.99).tolist() == [0.0, 0.0]
    assert stamped(3.0).tolist() == [1.0, 2.0]


@pytest.mark.parametrize(('message', 'text'), [
    ((JOINTS,), 'points: expected at least one, got none'),
    ((('a', 'b'), (0.0, [0.0, 0.0])), 'joint_names: expected joint_1, joint_2, got a, b'),
    ((JOINTS, (0.0, [0.0])), 'points.positions: expected 2 values, got 1'),
    ((JOINTS, (0.0, [0.0, np.nan])), 'points.positions of joint_2: expected a finite number'),
    ((JOINTS, (1.0, [0.0, 0.0]), (1.0, [0.0, 0.0])), 'expected increasing times'),
])
def test_a_bad_reference_is_rejected_and_the_old_one_kept(
    loop: RosLoop, message: Any, text: str,
) -> None:
    bench = Bench(loop, 'controller')
    reference = loop.publisher('reference')
    before = bench.node.set_points
    reference.publish(trajectory(message[0], *message[1:]))
    loop.until(lambda: bench.node.rejected['reference'] == 1)
    assert text in bench.node.last_rejection
    assert bench.node.set_points is before
    reference.publish(trajectory(JOINTS, (0.0, [0.0, 0.0])))
    loop.until(lambda: bench.node.set_points is not before)
