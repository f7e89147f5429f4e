"""Messages as real arms send them: jitter, losses, other names; and silence explained."""

from __future__ import annotations

from functools import partial
from importlib import resources
import operator
from pathlib import Path
import time
from typing import Any, TYPE_CHECKING

from node_bench import Bench, GAUGES, JOINTS, STEP
import numpy as np
import pytest

if TYPE_CHECKING:
    from rclpy.context import Context
    from ros_loop import RosLoop

pytestmark = pytest.mark.ros
SAMPLES = 400


def measured(payload: float = 0.1) -> list[Any]:
    """Return measurements of an arm that swings."""
    from flex_plant_sim.simulation.plant_setup import simulator_of
    from msg_config.parameters import check_parameters

    simulator = simulator_of(check_parameters(
        'plant_sim', {'modes': 2, 'payload': payload, 'seed': 2}))
    found = []
    for k in range(SAMPLES):
        found.append(simulator.measure())
        simulator.step(np.array([0.6, -0.8]) * (1.0 if (k // 40) % 2 else -1.0))
    return found


def final(loop: RosLoop, disturbed: bool, rows: list[Any]) -> tuple[float, float]:
    """Return mass and variance after the rows went over the topics, ideal or as they come."""
    from msg_config.messages import joint_state

    bench = Bench(loop, 'estimator', estimator='rpe', model='assumed_modes')
    payload = loop.record('payload_stamped')
    loop.until(lambda: bench.node.count_subscribers('payload_stamped') > 0)
    random = np.random.default_rng(1)
    for k, row in enumerate(rows):
        jitter, late, lost = random.integers(-200_000, 200_000), 0, False
        names, gauges = list(JOINTS), list(GAUGES)
        angle, effort, strain = list(row.angle), list(row.command), list(row.strain)
        if disturbed:
            names, angle, effort = (['gripper', *names[::-1]], [0.03, *angle[::-1]],
                                    [0.0, *effort[::-1]])
            gauges, strain = gauges[::-1], strain[::-1]
            late, lost = 300_000, bool(random.random() < 0.01)
        stamp = int(k * STEP + STEP + jitter * disturbed)
        bench.joint_states.publish(joint_state(stamp, names, angle, effort=effort))
        if not lost:
            bench.strain.publish(joint_state(stamp + late, gauges, strain))
            loop.until(partial(bench.answers.stamps.__contains__, stamp))
    loop.until(lambda: len(payload) > 0)
    result = payload[-1].position[0], payload[-1].effort[0]
    loop.stop(bench.node)
    return result


def test_a_real_stream_gives_the_payload_of_an_ideal_one(loop: RosLoop) -> None:
    rows = measured()
    ideal, variance = final(loop, False, rows)
    found, _ = final(loop, True, rows)
    assert ideal == pytest.approx(0.1, abs=0.01)
    assert abs(found - ideal) < np.sqrt(variance)


@pytest.mark.parametrize(('late', 'text'), [
    (None, 'no message on /strain'),
    (4_200_000, 'strain: header.stamp: expected within 4 ms of joint_states, got +4.2 ms'),
    ('names', 'every message is refused: strain: position: name: expected strain_1a')])
def test_why_nothing_is_estimated_is_said_within_two_seconds(
    loop: RosLoop, late: Any, text: str,
) -> None:
    from msg_config.messages import joint_state

    bench = Bench(loop, 'estimator')
    begin, k = time.monotonic(), 0
    while not (bench.status('samples') is not None and text in bench.status('samples').message):
        assert time.monotonic() < begin + 2.0, bench.status('samples')
        k += 1
        bench.joint_states.publish(joint_state(k * STEP, JOINTS, (0.1, 0.2), effort=(0.0, 0.0)))
        if late == 'names':
            bench.strain.publish(joint_state(k * STEP, ('a', 'b', 'c', 'd'), (0.0,) * 4))
        elif late:
            bench.strain.publish(joint_state(k * STEP + late, GAUGES, (0.0,) * 4))
        loop.wait(0.01)


def test_silence_tells_a_missing_publisher_from_one_of_another_type(
    loop: RosLoop, domain_id: int,
) -> None:
    import rclpy
    from rclpy.context import Context
    from std_msgs.msg import String

    bench = Bench(loop, 'estimator')

    def said(text: str) -> bool:
        status = bench.status('samples')
        return status is not None and status.message == f'no sample: no message on {text}'
    loop.until(partial(said, '/joint_states and /strain'))
    loop.observer.destroy_publisher(bench.strain)
    loop.until(partial(said, '/joint_states and /strain (no publisher)'))
    # One process cannot publish two types under one name.
    other = Context()
    rclpy.init(context=other, domain_id=domain_id)
    stranger = rclpy.create_node('stranger', context=other)
    stranger.create_publisher(String, 'strain', 1)
    loop.until(partial(said, '/joint_states and /strain (expected sensor_msgs/msg/JointState, '
                             'got std_msgs/msg/String)'))
    stranger.destroy_node()
    rclpy.shutdown(context=other)


def test_an_arm_of_other_names_units_and_signs_runs_the_same_loop(
    loop: RosLoop, tmp_path: Path,
) -> None:
    from flex_payload_estimator.nodes.lqg_controller_node import LQGControllerNode
    from flex_plant_sim.nodes.plant_sim_node import PlantSim

    text = (resources.files('flex_plant_sim') / 'robots' / 'reference.yaml').read_text()
    (tmp_path / 'mine.yaml').write_text(text + """
inputs:
  joints:
    joint_1: {name: base_yaw, unit: deg, sign: -1}
    joint_2: {name: forearm, unit: deg}
  gauges:
    strain_1a: {name: bridge_0, unit: um/m, sign: -1}
""")
    values = {'robot': str(tmp_path / 'mine.yaml'), 'model': 'paper_reduced', 'modes': 2}
    commands = loop.record('command')
    joints, strain = loop.record('joint_states'), loop.record('strain')
    loop.start(LQGControllerNode, **values, adapt=False, watchdog=0.0)
    plant = loop.start(PlantSim, **values)
    loop.until(lambda: len(commands.stamps) > 150)
    assert commands[0].name == joints[0].name == ['base_yaw', 'forearm']
    assert strain[0].name[0] == 'bridge_0'
    assert plant.simulator.state[:2] == pytest.approx([0.5, 0.5], abs=0.1)
    assert joints[-1].position[0] < -20.0, 'degrees, the other way'


def test_the_demo_s_recorder_takes_an_arm_s_own_names_and_units(ros_context: Context) -> None:
    from flex_payload_estimator.control.set_points import constant
    from flex_payload_estimator.nodes.topic_recorder import TopicRecorder
    from flex_plant_sim.arm.robot_file import parse_robot, robot_text
    from flex_plant_sim.simulation.extended_arm import ExtendedArm
    from flex_plant_sim.simulation.simulator import Simulator
    from msg_config.messages import joint_state

    robot = parse_robot(robot_text('reference') + """
inputs:
  joints: {joint_1: {name: base, unit: deg, sign: -1, offset: 0.5}, joint_2: forearm}
  gauges: {strain_1a: {name: sg7, unit: um/m}}
""", 'arm.yaml')
    recorder = TopicRecorder(1, robot, lambda *_: None, lambda: None, context=ros_context)
    joints, numbers = ('forearm', 'base'), np.arange(6.0)
    for topic, message in (
            ('joint_states', joint_state(0, joints, (0.25, 90.0), (3.0, 180.0))),
            ('strain', joint_state(0, ('sg7', *GAUGES[1:]), (100.0, 2.0, 3.0, 4.0))),
            ('command', joint_state(0, joints, effort=(3.0, 5.0))),
            ('innovation', joint_state(0, robot.output_names, numbers, effort=numbers + 1.0)),
            ('payload/inertia', None)):
        recorder.messages[topic][0] = message
    recorder.estimates[0] = (0.1, 1e-6, 2.0)
    record = recorder.record(Simulator(ExtendedArm(robot, 'paper_reduced', 2, 0.1)),
                             constant(0.0, 0.0))
    recorder.destroy_node()
    assert record.output[0] == pytest.approx([0.5 - np.pi / 2, 0.25, 1e-4, 2.0, 3.0, 4.0])
    assert record.velocity[0] == pytest.approx([-np.pi, 3.0])
    assert record.command[0] == pytest.approx([5.0, 3.0])
    assert record.innovation[0].tolist() == numbers.tolist()


def test_the_command_goes_to_zero_when_samples_stop_and_comes_back(loop: RosLoop) -> None:
    bench = Bench(loop, 'controller', watchdog=0.2)
    for k in range(5):
        bench.answered(k, angle=(-0.5, -0.5))
    assert np.abs(bench.answers[-1].effort).max() > 0.1
    loop.until(lambda: not np.any(bench.answers[-1].effort), 1.0)
    loop.until(lambda: bench.status('command') is not None
               and 'the command is zero' in bench.status('command').message, 2.0)
    bench.answered(5, angle=(-0.5, -0.5))
    assert np.abs(bench.answers[-1].effort).max() > 0.1


def test_a_command_is_held_for_one_refused_sample_and_then_zero(loop: RosLoop) -> None:
    bench = Bench(loop, 'controller')
    for k in range(5):
        bench.answered(k, angle=(-0.5, -0.5))
    before = list(bench.answers[-1].effort)
    bench.answered(5, angle=(1e9, -0.5))
    assert list(bench.answers[-1].effort) == before
    bench.answered(6, angle=(1e9, -0.5))
    assert list(bench.answers[-1].effort) == [0.0, 0.0]
    bench.answered(7, angle=(-0.5, -0.5))
    assert np.abs(bench.answers[-1].effort).max() > 0.1


def test_without_an_estimator_every_sample_is_answered_with_the_last_payload(
    loop: RosLoop,
) -> None:
    from msg_config.messages import inertia_message

    bench = Bench(loop, 'controller', adapt=True, watchdog=0.0)
    inertia = loop.publisher('payload/inertia')
    bench.sample(0)
    loop.wait(0.2)
    assert not bench.answers, 'it waits for the payload of its sample'
    inertia.publish(inertia_message(0, 0.2))
    loop.until(lambda: 0 in bench.answers.stamps)
    for k in range(1, 8):
        bench.sample(k)
    loop.until(lambda: bench.answers.stamps == {k * STEP for k in range(8)})
    loop.until(lambda: bench.status('command').message.startswith(
        'payload/inertia is late or missing'))
    assert bench.node._state()[0] == 'warn'
    assert bench.node.controller._mass == 0.2
    inertia.publish(inertia_message(7 * STEP, 1e9))
    bench.sample(8)
    loop.until(lambda: 8 * STEP in bench.answers.stamps)
    assert bench.node.controller._mass < 0.3, 'no faster than a gripper closes'


def test_a_command_that_waits_for_a_payload_is_not_said_to_wait_for_a_sample(
    loop: RosLoop,
) -> None:
    from msg_config.messages import inertia_message

    bench = Bench(loop, 'controller', adapt=True, watchdog=0.2)
    inertia = loop.publisher('payload/inertia')
    bench.sample(0, angle=(-0.5, -0.5))
    inertia.publish(inertia_message(0, 0.2))
    loop.until(lambda: 0 in bench.answers.stamps)

    def said(what: str) -> bool:
        # As a simulator in lock-step, which waits for the answer.
        bench.sample(1, angle=(-0.5, -0.5))
        status = bench.status('command')
        return status is not None and status.message.startswith(f'no {what} for ')
    loop.until(partial(said, 'payload/inertia'), 5.0)


@pytest.mark.parametrize('ahead', [True, False])
def test_payloads_in_time_are_waited_for_again_whichever_comes_first(
    loop: RosLoop, ahead: bool,
) -> None:
    from msg_config.messages import inertia_message

    bench = Bench(loop, 'controller', adapt=True, watchdog=0.0)
    inertia = loop.publisher('payload/inertia')
    for k in range(3):
        bench.sample(k)
    loop.until(lambda: STEP in bench.answers.stamps)
    payloads = bench.node.payloads
    assert payloads.late
    for k in range(3, 16):
        stamp = k * STEP
        if ahead:
            inertia.publish(inertia_message(stamp, 0.2))
            loop.until(partial(operator.contains, payloads.early, stamp))
        bench.sample(k)
        loop.until(partial(lambda at: at in bench.answers.stamps or not payloads.late, stamp))
        if not ahead:
            inertia.publish(inertia_message(stamp, 0.2))
            loop.wait(0.02)
    assert not payloads.late


def test_topics_of_the_robot_file_that_a_node_does_not_hear_are_said(
        loop: RosLoop, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    from flex_payload_estimator.nodes.lqg_controller_node import LQGControllerNode
    from ros_loop import overrides

    text = (resources.files('flex_plant_sim') / 'robots' / 'reference.yaml').read_text()
    own = tmp_path / 'own.yaml'
    own.write_text(text + 'inputs:\n  topics: {strain: /daq/strain}\n')
    for arguments, said in (([], True), (['--ros-args', '-r', 'strain:=/daq/strain'], False)):
        capfd.readouterr()
        node = loop.add(LQGControllerNode, cli_args=arguments, parameter_overrides=overrides(
            {'robot': str(own), 'modes': 1}))
        assert ('-r strain:=/daq/strain' in capfd.readouterr().err) is said
        loop.stop(node)


def test_a_payload_that_no_arm_carries_is_said_once_and_while_it_lasts(
        loop: RosLoop, capfd: pytest.CaptureFixture[str]) -> None:
    from msg_config.messages import inertia_message

    bench = Bench(loop, 'controller', adapt=True)
    payload = loop.publisher('payload/inertia')

    def told(text: str) -> bool:
        status = bench.status('lqg_controller: command')
        return status is not None and text in status.message
    capfd.readouterr()
    for k, mass in enumerate((50.0, 50.0, -9.0, 0.1)):
        payload.publish(inertia_message(k * STEP, mass))
        bench.answered(k)
        if k == 1:
            loop.until(lambda: told('got 50'))
    loop.until(lambda: told('ok'))
    assert capfd.readouterr().err.count('inertia.m: expected 0 to 0.732 kg') == 1
