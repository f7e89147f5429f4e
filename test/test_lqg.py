"""LQG controller (31): gain, set-points, limits, integral action, bad input."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
import math

from flex_payload_estimator.control.lqg import LQGController, LQGSettings
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Noise, Simulator
from msg_config.errors import InputError
import numpy as np
from paper_equations import omega_exact
import pytest
from scipy.linalg import solve_discrete_are

ROBOT = load_robot('reference')
PAPER = LQGSettings(integrator=False, command_limit=math.inf)
controller_of = partial(LQGController, ROBOT, 'paper_reduced', 2)


def run(controller: LQGController, target: Array, seconds: float, plant: str = 'paper_reduced',
        bias: float = 0.0, mass: float = 0.1) -> tuple[Array, Array]:
    """Return outputs and commands of a step to a target; bias is added behind the controller."""
    simulator = Simulator(ExtendedArm(ROBOT, plant, 2, 0.1), None, Noise())
    outputs: list[Array] = []
    commands: list[Array] = []
    for _ in range(round(seconds / 0.01)):
        sample = simulator.measure()
        # The controller knows what it asked for, not the bias.
        asked = commands[-1] if commands else np.zeros(2)
        commands.append(controller.command(sample.time, sample.output, asked, mass, target))
        outputs.append(sample.output)
        simulator.step(commands[-1] + bias)
    return np.array(outputs), np.array(commands)


@pytest.mark.parametrize('plant', ['paper_reduced', 'paper', 'assumed_modes'])
def test_both_joints_come_to_their_set_points_without_vibration(plant: str) -> None:
    target = np.array([0.5, -0.3])
    outputs, _ = run(controller_of(PAPER), target, 6.0, plant)
    np.testing.assert_allclose(outputs[-50:, :2], np.tile(target, (50, 1)), atol=2e-3)
    assert np.abs(outputs[-50:, 2:]).max() < 0.02 * np.abs(outputs[:, 2:]).max()


@pytest.mark.parametrize('model', ['paper', 'assumed_modes'])
def test_second_order_models_control_the_arm_too(model: str) -> None:
    target = np.array([-0.4, 0.4])
    outputs, _ = run(LQGController(ROBOT, model, 2, PAPER), target, 6.0, 'assumed_modes')
    np.testing.assert_allclose(outputs[-1, :2], target, atol=2e-3)


def test_the_iterated_gain_settles_at_the_optimal_one() -> None:
    controller = controller_of(replace(PAPER, mass_0=0.1))
    for k in range(400):
        controller.command(0.01 * k, np.zeros(6), np.zeros(2), 0.1, np.zeros(2))
    model = controller.model
    a_bar, b_bar = controller._stretched()
    f, g = np.eye(10) + 0.01 * a_bar, 0.01 * b_bar
    angles = np.eye(2, 10)
    q_1 = angles.T @ angles + np.outer(model.end_point, model.end_point)
    s = solve_discrete_are(f, g, q_1, 0.005 * np.eye(2))
    optimal = np.linalg.solve(0.005 * np.eye(2) + g.T @ s @ g, g.T @ s @ f)
    np.testing.assert_allclose(controller.gain, optimal, atol=1e-6 * np.abs(optimal).max())


@pytest.mark.parametrize('modes', [2, 6])
@pytest.mark.parametrize('terms', [1, 3, 5, 15])
def test_fewer_terms_leave_the_sampled_model_exact(terms: int, modes: int) -> None:
    settings = replace(PAPER, mass_0=0.1, terms=terms)
    controller = LQGController(ROBOT, 'paper_reduced', modes, settings)
    controller.command(0.0, np.array([0.2, -0.5, 0.0, 0.0, 0.0, 0.0]), np.zeros(2), 0.1,
                       np.zeros(2))
    *found, cosine = controller.transition
    a, b = controller.model.matrices(math.cos(-0.5), 0.1)
    big = omega_exact(a, controller.step)
    assert cosine == math.cos(-0.5)
    for part, wanted in zip(found, (big @ a, big @ b)):
        np.testing.assert_allclose(part, wanted, rtol=0.0, atol=1e-11 * np.abs(wanted).max())


def test_the_gain_follows_the_payload_only_if_told_to() -> None:
    gains = {}
    for adapt in (True, False):
        for mass in (0.0, 0.3):
            controller = controller_of(replace(PAPER, adapt=adapt))
            for k in range(300):
                controller.command(0.01 * k, np.zeros(6), np.zeros(2), mass, np.zeros(2))
            gains[adapt, mass] = controller.gain
    assert np.abs(gains[True, 0.3] - gains[True, 0.0]).max() > 0.1
    np.testing.assert_array_equal(gains[False, 0.3], gains[False, 0.0])
    np.testing.assert_allclose(gains[True, 0.0], gains[False, 0.0], atol=1e-12)


def test_commands_stay_inside_both_limits_and_the_arm_still_arrives() -> None:
    robot = ROBOT.with_drive(1, command_limit=0.6)
    controller = LQGController(robot, 'paper_reduced', 2, replace(
        PAPER, command_limit=1.0, integrator=True))
    outputs, commands = run(controller, np.array([0.5, 0.5]), 6.0)
    np.testing.assert_array_equal(np.abs(commands).max(axis=0), [1.0, 0.6])
    np.testing.assert_allclose(outputs[-1, :2], 0.5, atol=2e-3)


def test_integral_action_takes_a_bias_out_and_does_not_wind_up() -> None:
    target = np.array([0.5, 0.5])
    errors, overshoot = {}, {}
    for integrator in (False, True):
        settings = replace(PAPER, integrator=integrator, command_limit=1.0)
        outputs, _ = run(controller_of(settings), target, 8.0, bias=0.1)
        errors[integrator] = np.abs(outputs[-1, :2] - target).max()
        outputs, _ = run(controller_of(settings), target, 8.0)
        overshoot[integrator] = outputs[:, 0].max() - 0.5
    assert errors[False] > 5e-3
    assert errors[True] < 5e-4
    assert overshoot[True] < overshoot[False] + 5e-3


def test_a_common_factor_on_both_variances_leaves_the_predictor_as_it_is() -> None:
    gains = []
    for factor in (1.0, 16.0):
        controller = controller_of(replace(
            PAPER, integrator=True, r_1=factor * 1e-4, r_2=factor * 1e-4))
        run(controller, np.zeros(2), 8.0)
        gains.append(controller.kalman.gain)
    np.testing.assert_allclose(gains[1], gains[0], atol=1e-3 * np.abs(gains[0]).max())


def test_a_bad_sample_is_passed_over() -> None:
    controller = controller_of(PAPER)
    outputs, _ = run(controller, np.array([0.2, 0.2]), 1.0)
    command = controller.command(1.0, np.full(6, math.nan), np.array([math.inf, 0.0]), math.nan,
                                 np.array([0.2, 0.2]))
    assert np.isfinite(command).all()
    after = controller.command(1.01, outputs[-1], command, 0.1, np.array([0.2, 0.2]))
    assert np.isfinite(after).all()
    np.testing.assert_allclose(after, command, atol=0.5)


def test_wrong_shapes_and_set_points_are_refused() -> None:
    controller = controller_of(PAPER)
    with pytest.raises(InputError, match='output: expected 6 numbers'):
        controller.command(0.0, np.zeros(5), np.zeros(2), 0.1, np.zeros(2))
    with pytest.raises(InputError, match='set_point: expected finite'):
        controller.command(0.0, np.zeros(6), np.zeros(2), 0.1, np.array([0.0, math.nan]))
