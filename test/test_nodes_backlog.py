"""A node that is slower than its samples says so, and answers the newest."""

from __future__ import annotations

import time
from typing import Any, TYPE_CHECKING

from flex_payload_estimator.nodes.backlog import Backlog
from flex_plant_sim.inputs.stamps import Order, StampOrder, TIME_JUMP
from node_bench import Bench, GAUGES, JOINTS, STEP
import pytest

if TYPE_CHECKING:
    from rclpy.context import Context


def simulated(service: float, stall: float = 0.0, room: int = 1000, patience: float = 0.05,
              busy: float = 0.0) -> tuple[list[int], list[int], float]:
    """
    Run a node that takes so long for a sample every 1 ms, behind a queue, for 4 s.

    For `busy`, s, others take the processor: a sample takes 1.5 ms.

    Returns which samples it answered, which it passed over, and how long the last waited, s.
    """
    backlog, interval = Backlog(patience, 1e-3), 1e-3
    queue: list[int] = []
    answered: list[int] = []
    passed: list[int] = []
    now, came, waited = stall, 0, 0.0
    while now < 4.0:
        while came * interval <= now:
            queue.append(came)
            came += 1
        del queue[:-room]
        if not queue:
            now = came * interval
            continue
        k = queue.pop(0)
        waited = now - k * interval
        over = backlog.passes(waited, now)
        (passed if over else answered).append(k)
        now += 5e-5 if over else 1.5e-3 if now < busy else service
    return answered, passed, waited


def test_a_node_that_keeps_up_passes_nothing_over() -> None:
    answered, passed, _ = simulated(0.9e-3)
    assert (len(answered), passed) == (4000, [])


@pytest.mark.parametrize(('service', 'room', 'first'), [
    (0.8e-3, 1000, 0), (0.4e-3, 1000, 0), (0.8e-3, 100, 201)])
def test_after_a_stall_all_that_waits_is_answered(service: float, room: int, first: int) -> None:
    answered, passed, waited = simulated(service, stall=0.3, room=room)
    assert not passed
    assert answered[0] == first
    assert len(answered) == 4000 - first
    assert waited < 1e-3


@pytest.mark.parametrize('service', [1.2e-3, 2e-3, 4e-3])
def test_a_node_that_is_too_slow_answers_runs_of_samples_and_stays_near(service: float) -> None:
    answered, passed, waited = simulated(service)
    assert len(answered) > 0.8 * 4.0 / service
    assert waited < 0.1
    # In a row but for what is passed over, so that few gaps are to be bridged.
    gaps = sum(b > a + 4 for a, b in zip(answered, answered[1:]))
    assert 0 < gaps < 0.1 * len(answered)


def test_who_may_wait_longer_answers_what_came_while_others_took_the_processor() -> None:
    (some, soon, _), (whole, late, waited) = (
        simulated(0.6e-3, patience=patience, busy=0.4) for patience in (0.05, 0.5))
    assert soon and len(some) + len(soon) == 4000
    assert (len(whole), late) == (4000, [])
    assert waited < 1e-3


def test_what_is_lost_on_this_side_is_no_leap_of_the_stamps() -> None:
    for held_up, order in ((False, Order.AHEAD), (True, Order.NEW)):
        stamps = StampOrder(STEP)
        stamps.judge(0)
        assert stamps.judge(20 * STEP, held_up) is order
        assert stamps.judge(20 * STEP + 2 * TIME_JUMP, held_up) is Order.AHEAD


def hand(node: Any, k: int, waited: float) -> None:
    """Give a node sample k as the executor does, as if it had waited, s."""
    from msg_config.messages import joint_state
    from rclpy.serialization import serialize_message

    for topic, names, numbers, more in (
            ('joint_states', JOINTS, (0.1, 0.2), {'effort': (0.0, 0.0)}),
            ('strain', GAUGES, (0.0,) * 4, {})):
        message = serialize_message(joint_state(k * STEP, names, numbers, **more))
        node._subscribed[topic].callback(
            (message, {'received_timestamp': time.time_ns() - round(1e9 * waited)}))


@pytest.mark.ros
def test_what_is_passed_over_is_said(ros_context: Context) -> None:
    from ros_loop import RosLoop

    loop = RosLoop(ros_context)
    bench = Bench(loop, 'estimator')
    bench.answered(0)
    # 30 lost in the queue; half a second later they wait longer.
    hand(bench.node, 30, 0.9)
    time.sleep(0.51)
    hand(bench.node, 31, 1.0)
    hand(bench.node, 40, 1.0)
    hand(bench.node, 41, 0.0)
    loop.until(lambda: 41 * STEP in bench.answers.stamps)
    assert bench.answers.stamps == {0, 30 * STEP, 41 * STEP}
    assert bench.node.rejected.total() == 0
    bench.node.report()
    loop.until(lambda: bench.status('samples').message ==
               'too slow: 10 of 1000 samples passed over in the last 10 s')
    loop.close()
