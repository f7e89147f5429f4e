"""What ill-made messages, parameters and clocks do to the nodes: one line, and they go on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any, TYPE_CHECKING

from flex_plant_sim.errors import InputError
import numpy as np
import pytest

if TYPE_CHECKING:
    from rclpy.context import Context
    from ros_loop import RosLoop

pytestmark = pytest.mark.ros

PAPER: dict[str, Any] = {'model': 'paper_reduced', 'modes': 2}
ESTIMATOR: dict[str, Any] = {**PAPER, 'estimator': 'sf1_paper'}
GAUGES = ('strain_1a', 'strain_1b', 'strain_2a', 'strain_2b')
JOINTS = ('joint_1', 'joint_2')
STEP = 10_000_000


@pytest.fixture
def loop(ros_context: Context) -> Iterator[RosLoop]:
    """Return an executor in a ROS domain of its own."""
    from ros_loop import RosLoop

    loop = RosLoop(ros_context)
    yield loop
    loop.close()


class Bench:
    """A node under test, fed by hand."""

    def __init__(self, loop: RosLoop, kind: str):
        from flex_payload_estimator.lqg_controller_node import LQGControllerNode
        from flex_payload_estimator.payload_estimator_node import PayloadEstimatorNode

        self.loop = loop
        self.answers = loop.record('payload/inertia' if kind == 'estimator' else 'command')
        self.diagnostics = loop.record('diagnostics')
        self.node = (loop.start(PayloadEstimatorNode, **ESTIMATOR) if kind == 'estimator'
                     else loop.start(LQGControllerNode, **PAPER, adapt=False))
        self.joint_states = loop.publisher('joint_states')
        self.strain = loop.publisher('strain')
        loop.until(lambda: self.answers_are_heard)

    @property
    def answers_are_heard(self) -> bool:
        """Return whether the recorder has found the node."""
        return bool(self.loop.observer.count_publishers(
            'payload/inertia' if 'payload' in self.node.get_name() else 'command'))

    def sample(self, k: int, angle: Any = (0.1, 0.2), strain: Any = (0.0,) * 4, *,
               joints: Any = JOINTS, gauges: Any = GAUGES, effort: Any = (0.0, 0.0)) -> None:
        """Publish sample k."""
        from msg_config.messages import joint_state

        self.joint_states.publish(joint_state(k * STEP, joints, angle, effort=effort))
        self.strain.publish(joint_state(k * STEP, gauges, strain))

    def answered(self, k: int) -> None:
        """Publish a good sample k and wait for its answer."""
        self.sample(k)
        self.loop.until(lambda: k * STEP in self.answers.stamps)

    def status(self, name: str) -> Any:
        """Return the latest status of a name."""
        found = [s for m in self.diagnostics for s in m.status if s.name.endswith(name)]
        return found[-1] if found else None


@pytest.fixture(params=['estimator', 'controller'])
def bench(request: pytest.FixtureRequest, loop: RosLoop) -> Bench:
    """Return the estimator, and the controller without an estimate, on the bench."""
    bench = Bench(loop, request.param)
    bench.answered(0)
    return bench


BAD: dict[str, tuple[str, Callable[[Bench], None], str]] = {
    'too few gauges': (
        'strain', lambda b: b.sample(1, strain=(0.0,) * 3, gauges=GAUGES[:3]), 'strain_2b'),
    'fewer values than names': ('strain', lambda b: b.sample(1, strain=(0.0,) * 3), 'got 3'),
    "another robot's gauges": (
        'strain', lambda b: b.sample(1, strain=(0.0, 0.0), gauges=('strain_1', 'strain_2')),
        'strain_1a'),
    'unknown joints': (
        'joint_states', lambda b: b.sample(1, joints=('shoulder', 'elbow')), 'joint_1'),
    'no names': ('joint_states', lambda b: b.sample(1, angle=(), joints=(), effort=()),
                 'joint_1'),
    'a name twice': (
        'joint_states', lambda b: b.sample(1, (0.0,) * 3, effort=(0.0,) * 3,
                                           joints=('joint_1', 'joint_2', 'joint_2')), 'once'),
}


@pytest.mark.parametrize('case', BAD)
def test_what_does_not_fit_is_rejected_and_counted(bench: Bench, case: str) -> None:
    topic, publish, text = BAD[case]
    publish(bench)
    bench.loop.until(lambda: bench.node.rejected[topic] == 1)
    bench.answered(2)
    assert STEP not in bench.answers.stamps
    assert text in bench.node.last_rejection
    assert '\n' not in bench.node.last_rejection


def test_rejections_are_told_on_diagnostics(bench: Bench) -> None:
    bench.sample(1, strain=(0.0,) * 3)
    bench.answered(2)
    bench.loop.until(lambda: bench.status('input') is not None
                     and bench.status('input').message.startswith('1 messages rejected'))
    assert {value.key: value.value for value in bench.status('input').values}['rejected'] == '1'


@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize('where', ['angle', 'strain', 'effort'])
def test_what_is_not_finite_is_rejected_and_the_sample_still_answered(
    bench: Bench, bad: float, where: str,
) -> None:
    value = {'angle': (bad, 0.0), 'strain': (0.0, 0.0, bad, 0.0), 'effort': (0.0, bad)}[where]
    bench.sample(1, **{where: value})
    bench.loop.until(lambda: STEP in bench.answers.stamps)
    assert bench.node.rejected.total() == 1
    for k in range(2, 6):
        bench.answered(k)
    for message in bench.answers:
        values = [message.inertia.m] if hasattr(message, 'inertia') else message.effort
        assert np.all(np.isfinite(values))


def test_a_robot_without_effort_needs_a_command_topic(loop: RosLoop) -> None:
    from msg_config.messages import joint_state

    innovation = loop.record('innovation')
    bench = Bench(loop, 'estimator')
    bench.answered(0)
    bench.sample(1, effort=(0.5, -0.5))
    loop.until(lambda: STEP in innovation.stamps)
    assert loop.call('payload_estimator', 'reset').success
    bench.answered(0)
    bench.sample(1, effort=())
    loop.until(lambda: bench.node.rejected['joint_states'] == 1)
    assert 'effort: expected 2 values' in bench.node.last_rejection
    command = loop.publisher('command')
    command.publish(joint_state(0, JOINTS[::-1], effort=(-0.5, 0.5)))
    loop.until(lambda: bench.node.commanded is not None)
    bench.sample(1, effort=())
    loop.until(lambda: len([m for m in innovation if m.header.stamp.nanosec == STEP]) == 2)
    one, other = [m for m in innovation if m.header.stamp.nanosec == STEP]
    assert one == other


def test_channels_are_taken_by_name(loop: RosLoop) -> None:
    innovation = loop.record('innovation')
    bench = Bench(loop, 'estimator')
    strain, angle = np.array([1e-5, 2e-5, 3e-5, 4e-5]), np.array([0.1, 0.2])
    bench.answered(0)
    bench.sample(1, angle, strain)
    loop.until(lambda: STEP in innovation.stamps)
    assert loop.call('payload_estimator', 'reset').success
    bench.answered(0)
    bench.sample(1, angle[::-1], strain[::-1], joints=JOINTS[::-1], gauges=GAUGES[::-1])
    loop.until(lambda: len([m for m in innovation if m.header.stamp.nanosec == STEP]) == 2)
    one, other = [m for m in innovation if m.header.stamp.nanosec == STEP]
    assert one == other
    assert one.position[2] != one.position[3]


def test_a_late_sample_is_rejected_and_a_looping_bag_starts_afresh(bench: Bench) -> None:
    for k in range(1, 20):
        bench.answered(k)
    first = bench.answers[0]
    bench.sample(5)
    bench.loop.until(lambda: bench.node.rejected.total() == 1)
    assert 'expected more than 0.19 s, got 0.05 s' in bench.node.last_rejection
    bench.answered(20)
    bench.answers.clear()
    bench.sample(0)
    bench.answered(1)
    assert bench.node.rejected.total() == 2
    assert list(bench.answers.stamps) == [STEP]
    answer = bench.answers[0]
    if hasattr(answer, 'inertia'):
        assert answer.inertia.m == first.inertia.m
    bench.answered(2)


def test_lost_samples_are_counted(bench: Bench) -> None:
    bench.answered(1)
    bench.answered(4)
    bench.loop.until(lambda: bench.status('samples') is not None
                     and bench.status('samples').message.startswith('2 samples lost'))
    assert bench.node.rejected.total() == 0


def test_a_late_subscriber_gets_the_last_payload(loop: RosLoop) -> None:
    bench = Bench(loop, 'estimator')
    for k in range(5):
        bench.answered(k)
    late = loop.record('payload')
    loop.until(lambda: len(late) > 0)
    assert [dimension.label for dimension in late[0].layout.dim] == [
        'mass kg', 'variance kg^2', 'P kg^2']
    assert late[0].data[0] == bench.answers[-1].inertia.m
    assert late[0].data[1] > 0.0


def test_diagnostics_name_the_estimate_and_the_model(loop: RosLoop) -> None:
    bench = Bench(loop, 'estimator')
    random = np.random.default_rng(0)
    for k in range(450):
        bench.sample(k, 1e-2 * random.standard_normal(2), 1e-4 * random.standard_normal(4))
        loop.until(partial(bench.answers.stamps.__contains__, k * STEP))
    loop.until(lambda: bench.status('model') is not None
               and any('nis' in value.key for value in bench.status('model').values))
    values = {value.key: value.value for value in bench.status('model').values}
    for name in (*JOINTS, *GAUGES):
        assert float(values[f'{name} nis']) >= 0.0
        assert float(values[f'{name} whiteness']) >= 0.0
    assert {value.key for value in bench.status('estimate').values} >= {
        'status', 'mass kg', 'standard deviation kg'}


def test_a_payload_change_is_announced_at_once_with_its_time(loop: RosLoop) -> None:
    from argparse import Namespace

    bench = Bench(loop, 'estimator')
    for k in range(5):
        bench.answered(k)
    before = len(bench.diagnostics)
    # What an estimator that looks for changes keeps: see estimators/rpe_events.py.
    bench.node.estimator.events = [Namespace(time=0.02, found=0.05, before=0.2, after=0.05)]
    bench.answered(5)
    loop.until(lambda: len(bench.diagnostics) > before)
    status = bench.status('payload change')
    assert status.message == ('the payload went from 0.2 to 0.05 kg at 0.02 s, '
                              'found at 0.05 s')
    assert {value.key: value.value for value in status.values}['found s'] == '0.05'


def _raise(*_: Any) -> Any:
    raise np.linalg.LinAlgError('singular')


def test_an_estimator_that_fails_at_once_is_asked_again(loop: RosLoop) -> None:
    bench = Bench(loop, 'estimator')
    update, bench.node.estimator.update = bench.node.estimator.update, _raise
    bench.sample(0)
    loop.until(lambda: bench.node.rejected['payload'] == 1)
    bench.node.estimator.update = update
    bench.answered(0)


def test_an_estimate_that_is_not_finite_is_not_published(loop: RosLoop) -> None:
    bench = Bench(loop, 'estimator')
    for k in range(5):
        bench.answered(k)
    good, update = bench.answers[-1].inertia.m, bench.node.estimator.update
    bench.node.estimator.update = lambda *sample: replace(update(*sample), variance=np.nan)
    bench.answered(5)
    assert bench.answers[-1].inertia.m == good
    bench.node.estimator.update = _raise
    bench.answered(6)
    assert bench.answers[-1].inertia.m == good
    assert 'the estimate at 0.05 s is not finite' in bench.node.last_rejection
    loop.until(lambda: 'not finite' in bench.status('estimate').message)
    bench.node.estimator.update = update
    bench.answered(7)
    assert np.isfinite(bench.answers[-1].inertia.m)


# ---- the plant

def plant(loop: RosLoop, **values: Any) -> Any:
    """Start plant_sim."""
    from flex_plant_sim.plant_sim_node import PlantSim

    return loop.start(PlantSim, **{**PAPER, **values})


@pytest.mark.parametrize(('names', 'effort', 'stamp', 'text'), [
    (JOINTS, (np.nan, 0.0), 0, 'command: effort of joint_1: expected a finite number, got nan'),
    (JOINTS, (0.0, -np.inf), 0, 'effort of joint_2: expected a finite number, got -inf'),
    (JOINTS, (0.0,), 0, 'command: effort: expected 2 values, one a name, got 1'),
    (('shoulder', 'elbow'), (0.0, 0.0), 0, 'joint_1 is missing from shoulder, elbow'),
    (JOINTS, (0.0, 0.0), 1, 'command: header.stamp: expected at most 0 s, got 1e-09 s'),
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
    node = plant(loop, payload=0.2)
    loop.until(lambda: node._markers.get_subscription_count() > 0)
    assert loop.call('plant_sim', 'reset').success
    loop.until(lambda: len(markers) > 0)
    upper, lower, ball = markers[-1].markers
    assert (upper.type, lower.type, ball.type) == (
        Marker.LINE_STRIP, Marker.LINE_STRIP, Marker.SPHERE)
    assert (upper.points[0].x, upper.points[0].y) == (0.0, 0.0)
    assert upper.points[-1] == lower.points[0]
    # At rest and straight: 0.6 m + 0.5 m along x.
    assert (lower.points[-1].x, lower.points[-1].y) == (pytest.approx(1.1), 0.0)
    assert ball.pose.position.x == pytest.approx(1.1)


def test_real_time_holds_a_late_command_and_reports_it(loop: RosLoop) -> None:
    from msg_config.messages import joint_state

    joints, diagnostics = loop.record('joint_states'), loop.record('diagnostics')
    node = plant(loop, mode='realtime')
    command = loop.publisher('command')
    loop.until(lambda: len(joints) > 5)
    stamp = max(joints.stamps)
    command.publish(joint_state(stamp - 2 * STEP, JOINTS, effort=(0.3, 0.2)))
    loop.until(lambda: node._held > 3)
    assert node.simulator.measure().command.tolist() == [0.3, 0.2]
    loop.until(lambda: any('no command in time' in s.message or 'no command for' in s.message
                           for m in diagnostics for s in m.status))
    loop.until(lambda: node.simulator.measure().command.tolist() == [0.0, 0.0])


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


# ---- parameters

@pytest.mark.parametrize(('values', 'text'), [
    ({'robot': 'nobody'}, "plant_sim: robot: expected one of .*, got 'nobody'"),
    ({'payload_schedule': [1.0]}, 'plant_sim: payload_schedule: expected pairs .*, got 1'),
    ({'payload_schedule': [2.0, 0.1, 1.0, 0.1]}, 'plant_sim: payload: expected times that do not'),
    ({'payload_schedule': [1.0, -0.1]}, 'plant_sim: payload: expected a mass >= 0 kg, got -0.1'),
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
    from flex_payload_estimator.payload_estimator_node import PayloadEstimatorNode

    with pytest.raises(InputError, match='^payload_estimator: regression: paper needs model '
                                         'paper_reduced'):
        loop.start(PayloadEstimatorNode, estimator='sf1_paper', model='assumed_modes')


# ---- set-points

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
    from flex_payload_estimator.trajectory import Trajectory

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
