"""The three nodes in lock-step: the offline loop's numbers, and nothing that stops the loop."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TYPE_CHECKING

from msg_config.parameters import check_parameters
import numpy as np
import pytest

if TYPE_CHECKING:
    from rclpy.context import Context
    from ros_loop import RosLoop

pytestmark = pytest.mark.ros

PAPER = {'model': 'paper_reduced', 'modes': 2}
# A machine that stands still for half a second must not change a number.
CALM = {'watchdog': 0.0}
SF1_PAPER: dict[str, dict[str, Any]] = {
    'plant_sim': {**PAPER, 'seed': 3}, 'lqg_controller': {**PAPER, **CALM},
    'payload_estimator': {**PAPER, 'estimator': 'sf1_paper'}}
DEFAULT: dict[str, dict[str, Any]] = {
    'plant_sim': {'seed': 5}, 'lqg_controller': {**CALM}, 'payload_estimator': {}}
SAMPLES = 301


def start_all(loop: RosLoop, values: dict[str, dict[str, Any]]) -> tuple[Any, Any, Any]:
    """Start the three nodes."""
    from flex_payload_estimator.nodes.lqg_controller_node import LQGControllerNode
    from flex_payload_estimator.nodes.payload_estimator_node import PayloadEstimatorNode
    from flex_plant_sim.nodes.plant_sim_node import PlantSim

    kinds = {'plant_sim': PlantSim, 'payload_estimator': PayloadEstimatorNode,
             'lqg_controller': LQGControllerNode}
    plant, estimator, controller = (
        loop.start(kind, **values[name]) for name, kind in kinds.items())
    return plant, estimator, controller


def offline(values: dict[str, dict[str, Any]], samples: int) -> Any:
    """Return the offline loop's record of the same experiment."""
    from flex_payload_estimator.control.loop import run_loop
    from flex_payload_estimator.nodes.node_setup import controller_of, estimator_of, set_points_of
    from flex_plant_sim.simulation.plant_setup import simulator_of

    tables = {name: check_parameters(name, own) for name, own in values.items()}
    simulator = simulator_of(tables['plant_sim'])
    return run_loop(simulator, estimator_of(tables['payload_estimator']),
                    controller_of(tables['lqg_controller']),
                    set_points_of(tables['lqg_controller']),
                    (samples - 1) * simulator.arm.robot.sample_time)


@pytest.mark.parametrize('values', [SF1_PAPER, DEFAULT], ids=['sf1_paper', 'default'])
def test_the_topics_carry_the_offline_loop_s_numbers(
    loop: RosLoop, values: dict[str, dict[str, Any]],
) -> None:
    topics = {name: loop.record(name) for name in (
        'joint_states', 'strain', 'payload/inertia', 'innovation', 'command')}
    start_all(loop, values)
    loop.until(lambda: len(topics['command'].stamps) >= SAMPLES)
    found = {name: list(messages.by_stamp().values())[:SAMPLES]
             for name, messages in topics.items()}
    record = offline(values, SAMPLES)
    for name, wanted, got in (
        ('mass', record.mass, [m.inertia.m for m in found['payload/inertia']]),
        ('joint', record.output[:, :2], [m.position for m in found['joint_states']]),
        ('velocity', record.velocity, [m.velocity for m in found['joint_states']]),
        ('strain', record.output[:, 2:], [m.position for m in found['strain']]),
        ('innovation', record.innovation, [m.position for m in found['innovation']]),
        ('command', record.command, [m.effort for m in found['command']]),
    ):
        assert len(got) == SAMPLES, name
        np.testing.assert_allclose(np.array(got), wanted, rtol=0.0, atol=1e-12, err_msg=name)
    assert np.ptp(record.mass) > 0.01


@pytest.fixture
def strain_of(ros_context: Context) -> Callable[[int], list[bytes]]:
    """Return what runs a seed, and returns its first 50 strain samples as bytes."""
    from ros_loop import RosLoop

    def run(seed: int) -> list[bytes]:
        loop = RosLoop(ros_context)
        strain = loop.record('strain')
        start_all(loop, {**SF1_PAPER, 'plant_sim': {**PAPER, 'seed': seed}})
        loop.until(lambda: len(strain.stamps) >= 50)
        loop.close()
        return [m.position.tobytes() for m in list(strain.by_stamp().values())[:50]]
    return run


def test_a_seed_makes_the_same_bits_and_another_seed_does_not(
    strain_of: Callable[[int], list[bytes]],
) -> None:
    first, again, other = strain_of(1), strain_of(1), strain_of(2)
    assert first == again != other


def test_the_clock_is_the_stamp_of_the_samples(loop: RosLoop) -> None:
    clock, joints = loop.record('/clock'), loop.record('joint_states')
    start_all(loop, SF1_PAPER)
    loop.until(lambda: len(joints.stamps) >= 20 and len(clock) >= 20)
    times = {m.clock.sec * 10**9 + m.clock.nanosec for m in clock}
    assert len(times) >= 18
    assert len(times & joints.stamps) >= 18


def test_nodes_may_come_late_in_any_order_and_be_replaced(loop: RosLoop) -> None:
    from flex_payload_estimator.nodes.lqg_controller_node import LQGControllerNode
    from flex_payload_estimator.nodes.payload_estimator_node import PayloadEstimatorNode
    from flex_plant_sim.nodes.plant_sim_node import PlantSim

    joints, commands = loop.record('joint_states'), loop.record('command')
    controller = loop.start(LQGControllerNode, **SF1_PAPER['lqg_controller'])
    loop.start(PlantSim, **SF1_PAPER['plant_sim'])
    loop.until(lambda: len(joints) >= 4)
    assert len(joints.stamps) == 1, 'the first sample goes out again until it is answered'
    loop.start(PayloadEstimatorNode, **SF1_PAPER['payload_estimator'])
    loop.until(lambda: len(commands.stamps) >= 20)
    loop.stop(controller)
    seen = len(joints.stamps)
    loop.start(LQGControllerNode, **SF1_PAPER['lqg_controller'])
    loop.until(lambda: len(joints.stamps) >= seen + 20)


@pytest.mark.parametrize('topic', ['strain', 'payload/inertia', 'command'])
def test_a_lost_message_does_not_stop_the_loop_and_changes_no_number(
    loop: RosLoop, topic: str, monkeypatch: pytest.MonkeyPatch,
) -> None:
    from msg_config.messages import stamp_of
    from rclpy.publisher import Publisher
    from rclpy.serialization import deserialize_message

    real, lost = Publisher.publish, set()

    def publish(self: Any, message: Any) -> None:
        if self.topic_name == f'/{topic}':
            raw = isinstance(message, bytes)
            stamp = stamp_of(deserialize_message(message, self.msg_type) if raw else message)
            if stamp in (70_000_000, 120_000_000) and stamp not in lost:
                lost.add(stamp)
                return
        real(self, message)
    monkeypatch.setattr(Publisher, 'publish', publish)
    commands = loop.record('command')
    start_all(loop, SF1_PAPER)
    loop.until(lambda: len(commands.stamps) >= 31)
    assert len(lost) == 2
    sent = [m.effort for m in commands.by_stamp().values()][:31]
    np.testing.assert_allclose(np.array(sent), offline(SF1_PAPER, 31).command,
                               rtol=0.0, atol=1e-12)


def test_pause_step_and_go_on(loop: RosLoop) -> None:
    joints = loop.record('joint_states')
    plant, *_ = start_all(loop, SF1_PAPER)
    loop.until(lambda: len(joints.stamps) >= 10)
    refused = loop.call('plant_sim', 'step')
    assert not refused.success
    assert 'paused' in refused.message
    assert loop.call('plant_sim', 'pause', data=True).success
    loop.wait(0.3)
    samples = plant.simulator.samples
    loop.wait(0.3)
    assert plant.simulator.samples == samples
    for step in (1, 2, 3):
        assert loop.call('plant_sim', 'step').success
        loop.until(partial(lambda n: plant.simulator.samples == n, samples + step))
    loop.wait(0.3)
    assert plant.simulator.samples == samples + 3
    assert loop.call('plant_sim', 'pause', data=False).success
    loop.until(lambda: plant.simulator.samples > samples + 20)


def test_reset_repeats_the_experiment(loop: RosLoop) -> None:
    inertia = loop.record('payload/inertia')
    plant, estimator, controller = start_all(loop, SF1_PAPER)
    loop.until(lambda: len(inertia.stamps) >= 60)
    first = [m.inertia.m for m in list(inertia.by_stamp().values())[:60]]
    assert loop.call('plant_sim', 'pause', data=True).success
    for node in ('plant_sim', 'payload_estimator', 'lqg_controller'):
        assert loop.call(node, 'reset').success
    inertia.clear()
    assert loop.call('plant_sim', 'pause', data=False).success
    loop.until(lambda: len(inertia.stamps) >= 60)
    assert [m.inertia.m for m in list(inertia.by_stamp().values())[:60]] == first


def test_a_reset_of_the_plant_alone_starts_the_others_afresh(loop: RosLoop) -> None:
    inertia = loop.record('payload/inertia')
    plant, estimator, controller = start_all(loop, SF1_PAPER)
    loop.until(lambda: len(inertia.stamps) >= 60)
    first = [m.inertia.m for m in list(inertia.by_stamp().values())[:40]]
    before = len(inertia)
    assert loop.call('plant_sim', 'reset').success
    loop.until(lambda: any(m.header.stamp.nanosec == 0 and m.header.stamp.sec == 0
                           for m in inertia[before:]))
    begin = next(k for k, m in enumerate(inertia) if k >= before
                 and m.header.stamp.nanosec == m.header.stamp.sec == 0)
    loop.until(lambda: len(inertia) >= begin + 60)
    assert [m.inertia.m for m in list(inertia.by_stamp(begin).values())[:40]] == first
    assert estimator.rejected.total() == 1
