"""Stamps and clocks that tell no time: refused in one line, and no node ends or answers anew."""

from __future__ import annotations

from typing import Any, TYPE_CHECKING

from node_bench import Bench, STEP
import numpy as np
import pytest

if TYPE_CHECKING:
    from ros_loop import RosLoop

pytestmark = pytest.mark.ros


def test_a_clock_that_stands_still_is_told_from_one_that_never_came() -> None:
    from msg_config.clock_watch import ClockWatch

    watch = ClockWatch(1.0)
    assert 'got none' in watch(0, 0.0)
    assert watch(5_000_000_000, 1.0) == ''
    watch.sampled = 1.9
    assert watch(5_000_000_000, 2.0) == '', 'both may have stopped since'
    watch.sampled = 2.9
    assert watch(5_000_000_000, 3.0) == (
        'use_sim_time: /clock stands still at 5 s while samples come')
    assert watch(5_000_000_000, 9.0), 'it still does'
    assert watch(5_010_000_000, 10.0) == ''
    assert watch(5_010_000_000, 20.0) == '', 'no sample comes: all is paused'


@pytest.mark.parametrize('kind', ['estimator', 'controller'])
def test_other_measurements_under_the_same_stamp_are_refused_until_they_are_repeated(
    loop: RosLoop, kind: str,
) -> None:
    calm = {'watchdog': 0.0} if kind == 'controller' else {}
    bench = Bench(loop, kind, **calm)
    bench.answered(0)
    for k in range(1, 60):
        bench.sample(0, angle=(0.1 + 1e-3 * k, 0.2))
        loop.wait(0.01)
    loop.until(lambda: bench.node.rejected.total() == 59)
    assert len(bench.answers) == 1
    text = 'joint_states, strain: header.stamp: expected one after 0 s, got 0 s'
    assert bench.node.last_rejection == text
    silence = f'no sample: every sample is refused: {text}'
    loop.until(lambda: bench.status('samples') is not None
               and bench.status('samples').message == silence)
    # A simulation that was reset in its first step.
    for _ in range(2):
        bench.sample(0, angle=(0.05, 0.2))
    loop.until(lambda: len(bench.answers) == 2)
    bench.answered(1, angle=(0.05, 0.2))


def test_a_stamp_too_far_ahead_says_how_far_one_may_be(loop: RosLoop) -> None:
    bench = Bench(loop, 'estimator')
    bench.answered(0)
    bench.sample(5)
    loop.until(lambda: bench.node.rejected.total() == 1)
    assert bench.node.last_rejection == (
        'joint_states, strain: header.stamp: expected one at most 0.04 s after 0 s, got 0.05 s')


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


def test_a_number_in_another_unit_is_asked_about(loop: RosLoop) -> None:
    bench = Bench(loop, 'estimator')
    bench.answered(0)
    bench.answered(1, strain=(0.05, 0.0, 0.0, 0.0))
    assert 'got 0.05 (is it in ' in bench.node.last_rejection
    assert 'percent' in bench.node.last_rejection
    bench.answered(2, strain=(1e308, 1e308, 0.0, 0.0))
    assert 'm/m, got 1e+308' in bench.node.last_rejection


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
    if second == 1:
        for k in range(302, 335):
            bench.answered(k)
            loop.wait(0.1)
            if 'stands still' in parameters():
                break
        assert parameters() == 'use_sim_time: /clock stands still at 3 s while samples come'
