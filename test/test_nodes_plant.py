"""plant_sim: commands, markers, real time, and what a bad parameter says."""

from __future__ import annotations

from typing import Any, TYPE_CHECKING

from msg_config.errors import InputError
from node_bench import JOINTS, PAPER, STEP
import numpy as np
import pytest

if TYPE_CHECKING:
    from rclpy.context import Context
    from ros_loop import RosLoop

pytestmark = pytest.mark.ros


def plant(loop: RosLoop, **values: Any) -> Any:
    """Start plant_sim."""
    from flex_plant_sim.nodes.plant_sim_node import PlantSim

    return loop.start(PlantSim, **{**PAPER, **values})


@pytest.mark.parametrize(('names', 'effort', 'stamp', 'text'), [
    (JOINTS, (np.nan, 0.0), 0, 'command: effort of joint_1: expected a finite number, got nan'),
    (JOINTS, (0.0, -np.inf), 0, 'effort of joint_2: expected a finite number, got -inf'),
    (JOINTS, (0.0,), 0, 'command: effort: expected 2 values, one for each name, got 1'),
    (('hip', 'knee'), (0.0, 0.0), 0, 'joint_1 is missing from hip, knee'),
    (JOINTS, (0.0, 0.0), 1, 'command: header.stamp: expected at most 0 s, got 1e-09 s'),
    (JOINTS, (1e308, 0.0), 0,
     'command: effort: command of joint_1: expected at most 200, got 1e+308'),
])
def test_the_plant_rejects_a_bad_command(
    loop: RosLoop, names: Any, effort: Any, stamp: int, text: str,
) -> None:
    from msg_config.messages import joint_state

    node = plant(loop)
    command = loop.publisher('command')
    command.publish(joint_state(stamp, names, effort=effort))
    loop.until(lambda: node.rejected['command'] == 1)
    assert text in node.last_rejection
    assert node.simulator.samples == 0
    command.publish(joint_state(0, ('joint_2', 'joint_1'), effort=(0.25, -0.5)))
    loop.until(lambda: node.simulator.samples == 1)
    assert node.simulator.measure().command.tolist() == [-0.5, 0.25]


def test_a_command_is_taken_once(loop: RosLoop) -> None:
    from msg_config.messages import joint_state

    node = plant(loop)
    command = loop.publisher('command')
    for _ in range(5):
        command.publish(joint_state(0, JOINTS, effort=(0.1, 0.1)))
    loop.until(lambda: node.simulator.samples >= 1)
    loop.wait(0.3)
    assert node.simulator.samples == 1


def test_an_arm_that_diverges_publishes_no_number_and_waits_for_a_reset(loop: RosLoop) -> None:
    from msg_config.messages import joint_state

    joints = loop.record('joint_states')
    node = plant(loop)
    command = loop.publisher('command')
    node.simulator.state[:] = np.nan
    command.publish(joint_state(0, JOINTS, effort=(0.1, 0.1)))
    loop.until(lambda: node._diverged)
    loop.wait(0.3)
    assert joints.stamps == {0}
    assert not loop.call('plant_sim', 'pause', data=False).success
    assert 'reset' in loop.call('plant_sim', 'step').message
    assert loop.call('plant_sim', 'reset').success
    command.publish(joint_state(0, JOINTS, effort=(0.1, 0.1)))
    loop.until(lambda: STEP in joints.stamps)


def test_markers_show_both_links_and_the_payload(loop: RosLoop) -> None:
    from visualization_msgs.msg import Marker

    markers = loop.record('arm_markers')
    node = plant(loop, payload=0.2, frame_prefix='left_')
    loop.until(lambda: node._markers.get_subscription_count() > 0)
    assert loop.call('plant_sim', 'reset').success
    loop.until(lambda: len(markers) > 0)
    upper, lower, ball = markers[-1].markers
    assert (upper.type, lower.type, ball.type) == (
        Marker.LINE_STRIP, Marker.LINE_STRIP, Marker.SPHERE)
    assert (upper.points[0].x, upper.points[0].y) == (0.0, 0.0)
    assert upper.points[-1] == lower.points[0]
    assert {marker.header.frame_id for marker in markers[-1].markers} == {'left_base'}
    # At rest and straight: 0.6 m + 0.5 m along x.
    assert (lower.points[-1].x, lower.points[-1].y) == (pytest.approx(1.1), 0.0)
    assert ball.pose.position.x == pytest.approx(1.1)


def test_real_time_holds_a_late_command_and_reports_it(loop: RosLoop) -> None:
    from msg_config.messages import joint_state

    joints, diagnostics = loop.record('joint_states'), loop.record('/diagnostics')
    node = plant(loop, mode='realtime')
    command = loop.publisher('command')
    loop.until(lambda: len(joints) > 5)
    stamp = max(joints.stamps)
    command.publish(joint_state(stamp - 2 * STEP, JOINTS, effort=(0.3, 0.2)))
    loop.until(lambda: node.counts.total['held'] > 3)
    assert node.simulator.measure().command.tolist() == [0.3, 0.2]
    loop.until(lambda: any('no command in time' in s.message or 'no command for' in s.message
                           for m in diagnostics for s in m.status))
    loop.until(lambda: node.simulator.measure().command.tolist() == [0.0, 0.0])


def test_real_time_drops_what_came_while_the_node_was_inactive(loop: RosLoop) -> None:
    from msg_config.messages import joint_state

    diagnostics = loop.record('/diagnostics')
    node = plant(loop, mode='realtime', autostart=False)
    command = loop.publisher('command')
    command.publish(joint_state(0, JOINTS, effort=(0.3, 0.2)))
    loop.wait(0.2)
    node.trigger_configure()
    node.trigger_activate()
    loop.until(lambda: node.simulator.samples > 5)
    diagnostics.clear()
    loop.until(lambda: len(diagnostics) > 0)
    values = {value.key: value.value for status in diagnostics[-1].status
              for value in status.values}
    assert values['late'] == '0'


def test_real_time_keeps_pace_with_the_wall_clock(loop: RosLoop) -> None:
    import time

    joints = loop.record('joint_states')
    plant(loop, mode='realtime', publish_clock=False)
    loop.until(lambda: len(joints.stamps) > 0)
    begin, first = time.monotonic(), max(joints.stamps)
    loop.wait(1.0)
    elapsed = time.monotonic() - begin
    assert (max(joints.stamps) - first) * 1e-9 == pytest.approx(elapsed, abs=0.1)
    stamps = sorted(joints.stamps)
    assert np.all(np.diff(stamps) == STEP), 'no sample is left out'


def test_real_time_says_the_steps_that_it_skips(loop: RosLoop) -> None:
    """The stamps go on with the wall clock; what lies between two of them was not simulated."""
    import time

    joints, diagnostics = loop.record('joint_states'), loop.record('/diagnostics')
    node = plant(loop, mode='realtime')
    loop.until(lambda: len(joints.stamps) > 5)
    time.sleep(1.5)  # a computer that is busy with something else for 150 steps
    loop.until(lambda: node.counts.total['skipped'] > 100)
    end = node.simulator.samples + 20
    loop.until(lambda: node.simulator.samples > end)
    stamps = sorted(joints.stamps)
    missing = round(np.sum(np.diff(stamps) - STEP) / STEP)
    assert missing == pytest.approx(node.counts.total['skipped'], abs=2)
    loop.until(lambda: any(
        s.level == b'\x01' and f'{node.counts.total["skipped"]} steps were skipped' in s.message
        for m in diagnostics for s in m.status))


def test_real_time_takes_no_step_after_the_arm_diverged(loop: RosLoop) -> None:
    import time

    node = plant(loop, mode='realtime')
    loop.until(lambda: node.simulator.samples > 5)
    node.simulator.state[:] = np.nan
    before = node.simulator.samples
    time.sleep(20 * STEP * 1e-9)
    loop.until(lambda: node._diverged)
    assert node.simulator.samples == before + 1


@pytest.mark.parametrize(('values', 'text'), [
    ({'robot': 'nobody'}, "plant_sim: robot: expected one of .*, got 'nobody'"),
    ({'payload_schedule': [1.0]}, 'plant_sim: payload_schedule: expected pairs .*, got 1'),
    ({'payload_schedule': [2.0, 0.1, 1.0, 0.1]},
     'plant_sim: payload_schedule: expected times from 0 on that do not'),
    ({'payload_schedule': [1.0, -0.1]},
     'plant_sim: payload_schedule: expected masses from 0 to 1000 kg, got -0.1'),
    ({'effects': ['magic:joint_1:level=1']}, "plant_sim: effects: expected .*got 'magic'"),
    ({'effects': ['coulomb_friction:joint_3:level_n_m=1']}, "plant_sim: .*got 'joint_3'"),
    ({'effects': ['coulomb_friction']}, 'plant_sim: effect: expected identifier:site:'),
    ({'model': 'magic'}, "plant_sim: model: expected .*, got 'magic'"),
    ({'seed': -1}, 'plant_sim: .*seed'),
    ({'angle_noise': float('nan')}, 'plant_sim: .*angle_noise'),
])
def test_a_bad_parameter_is_one_line_that_names_the_node(
    loop: RosLoop, values: dict[str, Any], text: str,
) -> None:
    with pytest.raises(InputError, match=f'^{text}') as raised:
        plant(loop, **values)
    assert '\n' not in str(raised.value)


def test_a_bad_estimator_is_named(loop: RosLoop) -> None:
    from flex_payload_estimator.nodes.payload_estimator_node import PayloadEstimatorNode

    with pytest.raises(InputError, match='^payload_estimator: regression: paper needs model '
                                         'paper_reduced'):
        loop.start(PayloadEstimatorNode, estimator='sf1_paper', model='assumed_modes')


def test_two_arms_share_one_clock_and_none_in_real_time(ros_context: Context) -> None:
    from flex_plant_sim.nodes.plant_sim_node import PlantSim
    from ros_loop import overrides, RosLoop

    loop = RosLoop(ros_context)
    arms = [loop.add(PlantSim, namespace=namespace, parameter_overrides=overrides(PAPER))
            for namespace in ('left', 'right')]
    loop.until(lambda: loop.observer.count_publishers('/clock') == 2)
    loop.until(lambda: loop.observer.count_publishers('/clock') == 1)
    diagnostics = loop.record('/diagnostics')
    names = {'left/plant_sim: command', 'right/plant_sim: command'}
    loop.until(lambda: names <= {s.name for m in diagnostics for s in m.status})
    assert {s.hardware_id for m in diagnostics for s in m.status} == {'reference'}

    # When the arm that has the clock ends, the other one takes it over.
    def owners() -> set[str]:
        return {one.node_namespace for one in loop.observer.get_publishers_info_by_topic('/clock')}

    (first,), clock = owners(), loop.record('/clock')
    loop.stop(next(arm for arm in arms if arm.get_namespace() == first))
    loop.until(lambda: owners() == {'/left', '/right'} - {first})
    count = len(clock)
    loop.until(lambda: len(clock) > count)
    loop.close()


def test_real_time_has_wall_stamps_and_no_clock(loop: RosLoop) -> None:
    import time

    joints = loop.record('joint_states')
    plant(loop, mode='realtime')
    loop.until(lambda: len(joints) > 5)
    assert max(joints.stamps) * 1e-9 == pytest.approx(time.time(), abs=0.5)
    assert loop.observer.count_publishers('/clock') == 0


def test_the_measured_arm_lies_where_the_simulated_one_does() -> None:
    from flex_payload_estimator.nodes.measured_shape import MeasuredShape
    from flex_plant_sim.arm.robot_file import load_robot
    from flex_plant_sim.simulation.arm_shape import ArmShape
    from flex_plant_sim.simulation.extended_arm import ExtendedArm

    robot = load_robot('reference')
    arm = ExtendedArm(robot, 'assumed_modes', 2, robot.payload_mass)
    state = np.zeros(arm.states)
    state[:6] = 0.3, -0.5, 0.02, 0.003, -0.03, 0.004
    lines = MeasuredShape.of(robot).lines(arm.output(state, 0.0))
    straight = MeasuredShape.of(robot).lines(np.array([0.3, -0.5, 0.0, 0.0, 0.0, 0.0]))
    wanted = ArmShape.of(arm).lines(state)
    assert np.abs(lines - wanted).max() < 1e-9
    assert np.abs(straight - wanted).max() > 0.01
