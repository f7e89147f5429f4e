"""Stamps and clocks that tell no time: refused in one line, and no node ends or answers anew."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TYPE_CHECKING

from node_bench import Bench, STEP
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


def test_a_sample_that_is_repeated_after_the_watchdog_gets_no_older_command(
    loop: RosLoop,
) -> None:
    bench = Bench(loop, 'controller', watchdog=0.2)
    for k in range(5):
        bench.answered(k, angle=(-0.5, -0.5))
    assert np.abs(bench.answers[-1].effort).max() > 0.1
    loop.until(lambda: not np.any(bench.answers[-1].effort), 2.0)
    count = len(bench.answers)
    bench.sample(4, angle=(-0.5, -0.5))
    loop.until(lambda: len(bench.answers) > count)
    assert not np.any(bench.answers[-1].effort)


@pytest.mark.parametrize(('second', 'nanosecond'), [(-5, 0), (1, 2_000_000_000)])
def test_a_clock_that_is_no_time_ends_no_node(
    loop: RosLoop, second: int, nanosecond: int,
) -> None:
    from builtin_interfaces.msg import Time
    from rosgraph_msgs.msg import Clock

    bench = Bench(loop, 'estimator', use_sim_time=True)

    def parameters() -> str:
        status: Any = bench.status('parameters')
        return status.message if status is not None else ''
    loop.until(lambda: 'expected a time on /clock, got none' in parameters())
    clock = loop.publisher('/clock')
    clock.publish(Clock(clock=Time(sec=second, nanosec=nanosecond)))
    loop.until(lambda: bench.node.rejected['/clock'] == 1)
    assert bench.node.last_rejection == (
        '/clock: clock: expected sec >= 0 and nanosec < 1e9, got '
        f'{second} and {nanosecond}')
    clock.publish(Clock(clock=Time(sec=3)))
    loop.until(lambda: bench.node.get_clock().now().nanoseconds == 300 * STEP)
    loop.until(lambda: parameters() == 'ok')
    bench.answered(301)
