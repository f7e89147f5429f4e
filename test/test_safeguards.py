"""What limits commands and the believed payload."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
import math

from flex_payload_estimator.control.joint_watch import ObedienceWatch, SpeedWatch
from flex_payload_estimator.control.lqg import LQGController, LQGSettings, MOST_DOUBTED
from flex_payload_estimator.control.safeguards import (
    BelievedPayload,
    CLOSING_TIME,
    CommandLimiter,
)
from flex_payload_estimator.estimators.base import largest_payload
from flex_payload_estimator.nodes.node_setup import check_square
from flex_plant_sim.arm.robot_file import load_robot
from msg_config.errors import InputError
import numpy as np
import pytest

ROBOT = load_robot('reference')


def test_a_command_is_finite_and_inside_limit_and_slew() -> None:
    limiter, random = CommandLimiter(3.0, 50.0), np.random.default_rng(0)
    before = np.zeros(2)
    for _ in range(2000):
        wanted = random.choice([np.nan, np.inf, -np.inf, 1e308, -1e30, 2.0, -0.5, 0.0], 2)
        sent = limiter(wanted, 0.01)
        assert np.isfinite(sent).all()
        assert np.abs(sent).max() <= 3.0
        assert np.abs(sent - before).max() <= 0.5 + 1e-12
        before = sent
    limiter.limit = 0.1
    assert np.abs(limiter(np.array([3.0, 3.0]), 0.01)).max() <= 0.1, 'a limit goes before the slew'


@pytest.mark.parametrize('motion, obeys', [
    (lambda t: 0.2 + 0.0 * t, False), (lambda t: -3.0 * t, False), (lambda t: -5.0 * t * t, False),
    (lambda t: 3.0 * t, True), (lambda t: 0.2 * t * t, True), (lambda t: -2.0 * t + t * t, True)],
    ids=['still', 'away', 'ever faster away', 'follows', 'starts slowly', 'slows down'])
@pytest.mark.parametrize('sign', [-1, 1])
def test_a_joint_disobeys_that_stands_or_runs_away_under_a_large_command(
        motion: Callable[[np.ndarray], np.ndarray], obeys: bool, sign: int) -> None:
    watch, time = ObedienceWatch(), np.arange(0.0, 1.0, 0.01)
    noise = np.random.default_rng(0).normal(0.0, 2e-4, time.size)
    found = [watch(t, (angle, 0.0), (sign, 0), 0.5, 8.0 * 2e-4 * math.sqrt(2.0))
             for t, angle in zip(time, sign * motion(time) + noise)]
    first = next((k for k, joint in enumerate(found) if joint == 0), None)
    assert first is None if obeys else first in (50, 51)


def test_a_joint_that_stands_under_a_large_command_for_a_short_time_obeys() -> None:
    watch = ObedienceWatch()
    assert all(watch(0.01 * k, (0.0, 0.0), (k % 40 > 0, 0), 0.5, 1e-3) is None
               for k in range(500))


FASTEST = [5.0, 5.0]


def speeds(angle: Callable[[float], float], velocity: Callable[[float], float],
           seconds: float = 6.0) -> tuple[float | None, SpeedWatch]:
    """Return when a joint's angle and velocity are found to disagree, s, and the watch."""
    watch, random = SpeedWatch(FASTEST, 0.01), np.random.default_rng(3)
    for k in range(round(100 * seconds)):
        t = 0.01 * k
        if watch(t, (0.0, angle(t) + random.normal(0.0, 2e-4)), (0.0, velocity(t))) is not None:
            return t, watch
    return None, watch


@pytest.mark.parametrize('fault, within', [
    (lambda t: 0.5 * t, 1.0), (lambda t: 0.5, 0.02),
    (lambda t: math.sin(9.0) - math.sin(3.0 * (t + 3.0)), 0.2)],
    ids=['drifts', 'slips', 'sticks'])
def test_an_angle_that_leaves_its_tachometer_is_told(
        fault: Callable[[float], float], within: float) -> None:
    found, _ = speeds(lambda t: math.sin(3.0 * t) + (fault(t - 3.0) if t >= 3.0 else 0.0),
                      lambda t: 3.0 * math.cos(3.0 * t))
    assert found is not None and 3.0 <= found < 3.0 + within


@pytest.mark.parametrize('velocity, proved', [
    (lambda t: 0.0, False), (lambda t: 150.0 * math.cos(3.0 * t), False),
    (lambda t: math.nan, False), (lambda t: 3.15 * math.cos(3.0 * t), True),
    (lambda t: 3.0 * math.cos(3.0 * (t - 0.015)), True),
    (lambda t: 3.0 * math.cos(3.0 * t) + 0.05, True)],
    ids=['zeros', 'before the gear', 'none', '5 % off', 'late', 'with an offset'])
def test_a_velocity_that_is_no_good_or_a_little_off_stops_nothing(
        velocity: Callable[[float], float], proved: bool) -> None:
    found, watch = speeds(lambda t: math.sin(3.0 * t), velocity)
    assert found is None
    assert watch.proved == [False, proved]


def test_a_payload_is_believed_in_range_and_no_faster_than_a_gripper_closes() -> None:
    payload = BelievedPayload(0.1, 0.7)
    assert payload(math.nan, 0.0) == 0.1
    assert payload(0.2, 0.0) == 0.2
    assert payload(1.9, 0.01) == pytest.approx(0.2 + 0.7 * 0.01 / CLOSING_TIME)
    for k in range(2, 100):
        mass = payload(1e9, 0.01 * k)
    assert mass == 0.7
    assert payload(-5.0, 9.0) == 0.0
    assert payload(math.inf, 9.1) == 0.0


def _invert(index: int, output: np.ndarray) -> None:
    output[index] *= -1.0


def test_a_gauge_is_told_and_a_wall_a_push_and_another_payload_are_not() -> None:
    from flex_payload_estimator.control.arm_watch import ArmWatch
    from flex_payload_estimator.control.set_points import square
    from flex_plant_sim.simulation.extended_arm import ExtendedArm
    from flex_plant_sim.simulation.simulator import Noise, Simulator

    def fault(spoil: Callable[[np.ndarray], None] | None = None, wall: float = math.inf) -> str:
        controller = LQGController(ROBOT, 'assumed_modes', 2, LQGSettings(
            adapt=False, mass_0=0.1, command_limit=5.0, integrator=True))
        watch, target, sent = ArmWatch(ROBOT, controller, 5.0), square(0.4, 3.0), np.zeros(2)
        plant = Simulator(ExtendedArm(ROBOT, 'assumed_modes', 4, 0.25), None,
                          Noise(ROBOT.angle_noise, ROBOT.strain_noise), 31)
        for k in range(700):
            output = plant.measure().output.copy()
            if spoil is not None and k > 320:
                spoil(output)
            command = controller.command(0.01 * k, output, sent, 0.1, target(0.01 * k))
            watch(0.01 * k, output, (math.nan, math.nan), sent, sent, 9.0)
            plant.step(command)
            if plant.state[0] > wall:
                half = plant.state.size // 2
                plant.state[0], plant.state[half] = wall, min(0.0, plant.state[half])
            sent = command
        return watch.fault

    assert not fault()
    assert not fault(wall=0.25)
    for k in range(2, 6):
        assert fault(partial(_invert, k)).startswith('the gauges')


@pytest.mark.parametrize(('name', 'step', 'payload', 'watched'), [
    ('reference', 0.01, 0.3, True), ('reference', 0.0125, 0.3, True),
    ('reference', 0.02, 0.1, False), ('reference', 0.05, 0.1, False),
    ('quanser_2dsfl', 0.002, 0.3, True), ('quanser_2dsfl', 0.005, 0.3, False)])
def test_no_rate_of_the_samples_stops_an_arm_for_a_payload_that_is_not_known(
    name: str, step: float, payload: float, watched: bool,
) -> None:
    from flex_payload_estimator.control.arm_watch import ArmWatch
    from flex_payload_estimator.control.set_points import square
    from flex_plant_sim.simulation.extended_arm import ExtendedArm
    from flex_plant_sim.simulation.simulator import Noise, Simulator

    robot = replace(load_robot(name), sample_time=step)
    controller = LQGController(robot, 'assumed_modes', 3, LQGSettings(
        adapt=False, mass_0=0.0, command_limit=5.0, integrator=True))
    watch, target, sent = ArmWatch(robot, controller, 5.0), square(0.5, 4.0), np.zeros(2)
    plant = Simulator(ExtendedArm(robot, 'assumed_modes', 3, payload), None,
                      Noise(robot.angle_noise, robot.strain_noise), 3)
    for k in range(int(3.0 / step)):
        output = plant.measure().output
        command = controller.command(step * k, output, sent, 0.0, target(step * k))
        watch(step * k, output, (math.nan, math.nan), sent, sent, 9.0)
        plant.step(command)
        sent = command
    assert not watch.fault
    assert watched is not bool(watch.unwatched), watch.unwatched


def test_the_largest_payload_is_the_parameter_s_or_follows_from_the_robot() -> None:
    assert largest_payload(ROBOT, 0.3) == 0.3
    assert largest_payload(ROBOT, 0.0) == 4.0 * ROBOT.links[1].mass + 2.0 * ROBOT.payload_mass


def test_square_set_points_beyond_the_joints_are_refused() -> None:
    robot = replace(ROBOT, angle_limits=((-2.0, 2.0), (-0.4, 1.0)))
    check_square({'reference_amplitude': 0.4}, robot)
    check_square({'reference_amplitude': 3.0}, ROBOT)
    with pytest.raises(InputError, match='reference_amplitude: expected at most 0.4 rad, .*0.5'):
        check_square({'reference_amplitude': 0.5}, robot)


def test_a_predictor_that_is_lost_begins_again_at_the_measurement() -> None:
    controller = LQGController(ROBOT, 'paper_reduced', 2, LQGSettings(
        integrator=False, command_limit=5.0))
    output = np.array([0.1, 0.2, 0.0, 0.0, 0.0, 0.0])
    command = np.zeros(2)
    for k in range(50):
        command = controller.command(0.01 * k, output, command, 0.1, output[:2])
    assert controller.doubted == 0
    far = output + np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    for k in range(50, 50 + MOST_DOUBTED):
        command = controller.command(0.01 * k, far, command, 0.1, output[:2])
        assert controller.doubted == k - 49
        assert abs(controller.state[0] - far[0]) > 1.0
    controller.command(1.0, far, command, 0.1, output[:2])
    assert controller.doubted == 0
    assert controller.state[0] == pytest.approx(far[0])


def test_a_watch_follows_the_limit_of_commands_and_keeps_its_fault() -> None:
    from flex_payload_estimator.control.arm_watch import ArmWatch

    controller = LQGController(ROBOT, 'assumed_modes', 2, LQGSettings(
        integrator=False, command_limit=math.inf))
    watch = ArmWatch(ROBOT, controller, 1.0)
    watch.fault = 'joint_1: why'
    wider, fresh = watch.with_limit(5.0), ArmWatch(ROBOT, controller, 5.0)
    assert wider.fault == watch.fault and wider.limit == 5.0
    assert wider._speeds._floor == fresh._speeds._floor != watch._speeds._floor
