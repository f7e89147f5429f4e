"""What ill-made messages and clocks do to estimator and controller: one line, and on they go."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TYPE_CHECKING

from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.nominal import nominal_effects
from flex_plant_sim.simulation.payload_profile import PayloadProfile
from flex_plant_sim.simulation.simulator import Noise, Simulator
from node_bench import Bench, GAUGES, JOINTS, STEP
import numpy as np
import pytest
from scipy.stats import chi2

if TYPE_CHECKING:
    from ros_loop import RosLoop

pytestmark = pytest.mark.ros


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
        'joint_states', lambda b: b.sample(1, joints=('hip', 'knee')), 'joint_1'),
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
                     and bench.status('input').message.startswith('1 messages refused'))
    assert {value.key: value.value for value in bench.status('input').values}['refused'] == '1'


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


@pytest.mark.parametrize('none', [(), (np.nan, np.nan)])
def test_a_robot_without_effort_needs_a_command_topic(
        loop: RosLoop, none: tuple[float, ...]) -> None:
    from msg_config.messages import joint_state

    innovation = loop.record('innovation')
    bench = Bench(loop, 'estimator')
    bench.answered(0)
    bench.sample(1, effort=(0.5, -0.5))
    loop.until(lambda: STEP in innovation.stamps)
    assert loop.call('payload_estimator', 'reset').success
    bench.answered(0)
    bench.sample(1, effort=none)
    loop.until(lambda: bench.node.rejected['joint_states'] == 1)
    assert bench.node.last_rejection == ('joint_states: effort: expected 2 numbers, got none, and '
                                         'no command came on topic command yet')
    command = loop.publisher('command')
    command.publish(joint_state(0, JOINTS[::-1], effort=(-0.5, 0.5)))
    loop.until(lambda: bench.node.acting.sent is not None)
    bench.sample(1, effort=none)
    loop.until(lambda: len([m for m in innovation if m.header.stamp.nanosec == STEP]) == 2)
    one, other = [m for m in innovation if m.header.stamp.nanosec == STEP]
    assert one == other


def test_a_controller_begins_though_the_robot_says_no_effort(loop: RosLoop) -> None:
    """It waited for a command to be applied, and nobody else sends one."""
    bench = Bench(loop, 'controller')
    bench.answered(0, effort=())
    assert loop.call('lqg_controller', 'reset').success
    bench.answered(1, effort=())
    assert not bench.node.rejected


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
    assert 'expected one after 0.19 s, got 0.05 s' in bench.node.last_rejection
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
                     and bench.status('samples').values[0].value == '2')
    assert bench.status('samples').values[0].key == 'lost or uneven'
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
    """An arm at rest, with the noise of its file: the model holds, and diagnostics say so."""
    bench, robot = Bench(loop, 'estimator', r_1=1e-10), load_robot('reference')
    random = np.random.default_rng(0)
    for k in range(450):
        bench.sample(k, robot.angle_noise * random.standard_normal(2),
                     robot.strain_noise * random.standard_normal(4))
        loop.until(partial(bench.answers.stamps.__contains__, k * STEP))
    loop.until(lambda: bench.status('model') is not None
               and any('nis' in value.key for value in bench.status('model').values))
    values = {value.key: value.value for value in bench.status('model').values}
    for name in (*JOINTS, *GAUGES):
        nis = float(values[f'{name} nis'])
        assert chi2.ppf(1e-7, 400) < 400 * nis < chi2.isf(1e-7, 400)
        assert chi2.ppf(1e-7, 10) < 10 * float(values[f'{name} whiteness']) < chi2.isf(1e-7, 10)
    assert {value.key for value in bench.status('estimate').values} >= {
        'status', 'mass kg', 'standard deviation kg'}


def test_the_model_is_not_healthy_while_no_model_explains_the_estimate(loop: RosLoop) -> None:
    bench = Bench(loop, 'estimator')
    bench.answered(1)
    node = bench.node
    healthy = node.health.report()
    for status, level in (('ok', b'\0'), ('model_suspect', b'\1')):
        node._estimate = node._estimate._replace(status=status)
        found = node._model_status(healthy)
        assert found.level == level
        assert ('no known model explains' in found.message) is (status == 'model_suspect')


def test_a_payload_change_is_announced_at_once_with_its_time(loop: RosLoop) -> None:
    bench = Bench(loop, 'estimator', estimator='rpe', model='assumed_modes', modes=2)
    robot = load_robot('reference')
    simulator = Simulator(
        ExtendedArm(robot, 'assumed_modes', 2, 0.2, nominal_effects(robot, 'assumed_modes')),
        PayloadProfile.step(0.2, 2.3, 0.05), Noise(2e-4, 5e-7))
    command = np.zeros(2)
    for k in range(330):
        sample = simulator.measure()
        bench.answered(k, angle=sample.output[:2], strain=sample.output[2:], effort=command)
        command = 4.0 * (0.5 * np.sign(np.sin(np.pi * sample.time)) - sample.angle)
        simulator.step(command)
    loop.until(lambda: bench.status('payload change').message != 'none')
    values = {value.key: float(value.value)
              for value in bench.status('payload change').values}
    event = bench.node.estimator.events[-1]
    # The diagnostics round to twelve digits.
    assert values['time s'] == pytest.approx(event.time, rel=1e-9)
    assert values['found s'] == pytest.approx(event.found, rel=1e-9)
    assert event.time == pytest.approx(2.3, abs=0.2) and event.found < 2.8
    assert values['after kg'] == pytest.approx(0.05, abs=0.01)


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
    bench.node.estimator.update = lambda *sample: update(*sample)._replace(variance=np.nan)
    bench.answered(5)
    assert bench.answers[-1].inertia.m == good
    bench.node.estimator.update = _raise
    bench.answered(6)
    assert bench.answers[-1].inertia.m == good
    assert 'the estimate at 0.06 s is not finite' in bench.node.last_rejection
    loop.until(lambda: 'not finite' in bench.status('estimate').message)
    bench.node.estimator.update = update
    bench.answered(7)
    assert np.isfinite(bench.answers[-1].inertia.m)


def test_frames_bear_the_prefix_of_their_arm(loop: RosLoop) -> None:
    markers = loop.record('arm_markers')
    bench = Bench(loop, 'estimator', frame_prefix='left_')
    loop.until(lambda: bool(bench.node._seen))
    bench.answered(1)
    loop.until(lambda: len(markers) > 0)
    assert bench.answers[-1].header.frame_id == 'left_tip'
    assert {marker.header.frame_id for marker in markers[-1].markers} == {'left_base'}
