"""Two publishers on a topic: the first is kept, and it is said."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from msg_config.first_publisher import FirstPublisher, HELD_UP, SILENCE
from msg_config.recent_counts import RecentCounts, WINDOW
from node_bench import Bench, GAUGES, STEP
import pytest

if TYPE_CHECKING:
    from ros_loop import RosLoop


def gid(process: int, number: int) -> bytes:
    """Return a publisher's gid."""
    return bytes([process] * 12 + [0, 0, number, 3])


def test_the_first_publisher_is_kept_until_it_is_silent() -> None:
    first, one, other = FirstPublisher(), gid(1, 1), gid(2, 1)
    assert first.hears('strain', one, 0.0)
    assert not first.hears('strain', other, 0.1)
    assert first.hears('strain', one, 0.4)
    assert not first.hears('strain', other, 0.4 + SILENCE)
    assert first.hears('strain', other, 0.41 + SILENCE)
    assert first.hears('strain', one, 0.42 + SILENCE), 'it was only held up'
    assert not first.hears('strain', other, 0.43 + SILENCE)
    assert first.hears('strain', None, 0.43 + SILENCE), 'where the middleware tells none'


def test_a_publisher_that_was_long_dead_does_not_displace_another() -> None:
    first, one, other = FirstPublisher(), gid(1, 1), gid(2, 1)
    assert first.hears('strain', one, 0.0)
    for second in range(1, 7):
        assert first.hears('strain', other, 1.0 + 0.4 * second)
    assert not first.hears('strain', one, 1.41 + HELD_UP)
    assert first.hears('strain', other, 1.45 + HELD_UP)
    assert first.hears('strain', one, 1.5 + HELD_UP + SILENCE), 'the other is silent'


def test_joints_and_strain_are_of_one_process() -> None:
    first = FirstPublisher()
    assert first.hears('joint_states', gid(1, 1), 0.0)
    assert first.hears('strain', gid(2, 2), 0.0)
    assert first.hears('strain', gid(1, 2), 0.01)
    assert not first.hears('strain', gid(2, 2), 0.02)
    assert not first.hears('joint_states', gid(2, 1), 0.03)


def test_counts_of_long_ago_are_no_longer_told() -> None:
    counts: RecentCounts[str] = RecentCounts()
    for second in range(100):
        counts.add('a', float(second))
    assert counts.recent(99.5).total() == WINDOW
    counts.add('b', 120.0)
    assert counts.recent(120.5) == {'b': 1}
    assert counts.recent(200.0) == {}
    assert counts.total == {'a': 100, 'b': 1}


@pytest.mark.ros
@pytest.mark.parametrize('kind', ['estimator', 'controller'])
def test_a_second_publisher_is_not_heard_and_told_within_a_second(
    loop: RosLoop, kind: str,
) -> None:
    from msg_config.messages import joint_state

    bench = Bench(loop, kind)
    bench.answered(0)
    stranger = loop.publisher('strain')
    loop.until(lambda: bench.node.count_publishers('strain') == 2)
    for k in range(1, 4):
        stranger.publish(joint_state((k + 1) * STEP, GAUGES, (1.3e-4,) * 4))
        bench.answered(k)
    begin = time.monotonic()
    loop.until(lambda: bench.status('publishers') is not None
               and 'only the first is heard' in bench.status('publishers').message)
    assert time.monotonic() - begin < 1.2
    assert bench.status('publishers').message.startswith('2 publishers of strain')
    assert bench.node.rejected == {'strain': 3}
    loop.wait(SILENCE + 0.1)
    stranger.publish(joint_state(4 * STEP, GAUGES, (0.0,) * 4))
    bench.sample(4)
    loop.until(lambda: 4 * STEP in bench.answers.stamps)


def test_a_slow_publisher_is_no_silent_one() -> None:
    first, one, other = FirstPublisher(), gid(1, 1), gid(2, 1)
    first.silence = 3.0
    assert first.hears('strain', one, 0.0)
    assert not first.hears('strain', other, 0.9)
    assert first.hears('strain', one, 1.0)
    assert first.hears('strain', other, 4.1)


@pytest.mark.ros
def test_a_gripper_on_the_same_topic_is_ignored_whoever_comes_first(loop: RosLoop) -> None:
    from msg_config.messages import joint_state

    bench = Bench(loop, 'estimator')
    gripper = loop.publisher('joint_states')

    def grip(k: int) -> None:
        gripper.publish(joint_state(k * STEP, ('finger_left', 'finger_right'), (0.0, 0.0)))
    grip(0)
    loop.until(lambda: bench.node.rejected.total() == 1)
    assert 'joint_1 is missing from finger_left, finger_right' in bench.node.last_rejection
    for k in range(4):
        bench.answered(k)
        grip(k)
    # The arm's driver comes again after a pause in which the gripper goes on.
    begin = time.monotonic()
    while time.monotonic() - begin < SILENCE + 0.2:
        grip(4)
        loop.wait(0.02)
    driver = loop.publisher('joint_states')
    bench.joint_states = driver
    for k in range(5, 8):
        bench.answered(k)
    assert not bench.node.second_heard()


@pytest.mark.ros
def test_two_controllers_of_one_arm_both_say_so(loop: RosLoop) -> None:
    bench = Bench(loop, 'controller')
    bench.answered(0)
    assert bench.node.publisher_status().message == 'ok'
    loop.observer.create_publisher(type(bench.answers[0]), 'command', 1)
    loop.until(lambda: bench.status('publishers') is not None
               and bench.status('publishers').message == '2 publishers of command, this node '
                                                         'and others')
    assert bench.status('publishers').level == b'\x02'
