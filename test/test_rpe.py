"""The recursive-prediction-error estimator: derivatives, covariance, bound."""

from __future__ import annotations

from dataclasses import replace

from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_payload_estimator.estimators.rpe.levels import start_spread
from flex_payload_estimator.estimators.rpe.parts import tabulated
from flex_payload_estimator.kalman.cramer_rao import linearise, payload_bound
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.arm.state_space import zero_order_hold
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.payload_profile import PayloadProfile
from flex_plant_sim.simulation.simulator import Noise, Simulator
import numpy as np
import pytest
from rpe_runs import estimator_of, robot_with, Run, SIGMA


def test_the_schedule_and_its_derivatives_are_those_of_the_sampled_arm() -> None:
    robot = robot_with()
    schedule, _ = tabulated(replace(robot, angle_noise=1.0, strain_noise=1.0), 'assumed_modes', 2,
                            (), 0.7)
    arm = ExtendedArm(robot, 'assumed_modes', 2)

    def exact(angle: float, mass: float) -> Array:
        f, g, _ = arm.matrices(np.cos(angle), mass)
        return np.hstack([f - np.eye(len(f)), g])

    for angle, mass in ((0.3, 0.0003), (1.9, 0.1), (2.9, 0.35), (0.0, 0.69)):
        piece = schedule.cut(mass)
        away, width = mass - piece.payload, piece.value.shape[1]
        wave = np.cos(angle * schedule.order)
        slope, bend = (wave @ piece.slopes).reshape(2, width)
        found = wave @ piece.value + away * (slope + 0.5 * away * bend)
        size = np.abs(exact(angle, mass)).max()
        np.testing.assert_allclose(found, exact(angle, mass).ravel(), atol=3e-7 * size)
        over_mass = (exact(angle, mass + 1e-6) - exact(angle, mass - 1e-6 * (mass > 0))) / (
            1e-6 * (1 + (mass > 0)))
        np.testing.assert_allclose(slope + away * bend, over_mass.ravel(),
                                   atol=5e-4 * np.abs(over_mass).max())


def test_the_sensitivity_is_the_finite_difference_of_the_predictor() -> None:
    estimator = estimator_of()
    run = Run(estimator, PayloadProfile.constant(0.12), 1.5)
    stepper, h = estimator.stepper, estimator.bank.best()
    sample, step = estimator._sample, 1e-5

    def predicted(shift: float) -> Array:
        moved = h.copy()
        moved.mass, moved.x = h.mass + shift, h.x + shift * h.sens[:, 0]
        stepper.predict(moved, sample)
        return moved.x

    expected = (predicted(step) - predicted(-step)) / (2 * step)
    after = h.copy()
    stepper.predict(after, sample)
    size = np.abs(expected).max()
    assert size > 0.0 and run.mass.size
    np.testing.assert_allclose(after.sens[:, 0], expected, atol=1e-4 * size)


@pytest.mark.parametrize(('sigma', 'torque'), [(1e-2, 0.0), (1e-4, 0.0), (1e-3, 0.05)])
def test_it_reaches_the_bound_on_a_matched_model(sigma: float, torque: float) -> None:
    robot, errors = robot_with(sigma), []
    estimator = estimator_of(robot, torque_noise=(torque, torque))
    for seed, mass in enumerate((0.03, 0.07, 0.13, 0.2, 0.3)):
        run = Run(estimator, PayloadProfile.constant(mass), 3.0, seed)
        arm = ExtendedArm(robot, 'assumed_modes', 2, mass)
        model = linearise(arm, np.array(run.states[:-1]), np.array(run.commands[:-1]))
        noise = [robot.angle_noise] * 2 + [robot.strain_noise] * 4
        bound = payload_bound(model, noise, start_spread(arm), [torque] * 2)
        assert run.std[-1] == pytest.approx(bound[-1], rel=0.02)
        errors.append((run.mass[-1] - mass) / bound[-1])
        assert run.estimates[-1].status == 'ok' and not estimator.events
    # Five standard normal draws exceed this root mean square once in a thousand.
    assert np.sqrt(np.mean(np.square(errors))) < 2.03


@pytest.mark.parametrize('model', ['paper', 'paper_reduced'])
@pytest.mark.parametrize('modes', [1, 2, 4])
def test_every_model_and_number_of_modes(model: str, modes: int) -> None:
    robot = robot_with()
    estimator = make_estimator('rpe', robot, model, modes)
    assert isinstance(estimator, RecursivePredictionError)
    arm = ExtendedArm(robot, model, modes, 0.15)
    run = Run(estimator, PayloadProfile.constant(0.15), 2.0, arm=arm)
    assert abs(run.mass[-1] - 0.15) < 4 * run.std[-1] < 2e-3


def test_the_covariance_stays_symmetric_positive_definite_at_a_fine_step() -> None:
    robot = replace(robot_with(), sample_time=1e-4)
    estimator = estimator_of(robot)
    arm = ExtendedArm(robot, 'assumed_modes', 2, 0.1)
    run = Run(estimator, PayloadProfile.constant(0.1), 0.3, arm=arm)
    h = estimator.bank.best()
    scale = np.sqrt(np.diag(h.cov))
    assert np.array_equal(h.cov, h.cov.T)
    assert np.linalg.eigvalsh(h.cov / np.outer(scale, scale)).min() > 0.0
    assert h.variance > 0.0 and np.isfinite(run.mass).all()
    assert abs(run.mass[-1] - 0.1) < 4 * run.std[-1]


def test_the_joint_covariance_is_that_of_the_augmented_kalman_filter() -> None:
    # The Riccati recursion of (x, m) at the filter's own estimates, as an independent route.
    estimator = estimator_of()
    robot, arm = estimator.arm.robot, ExtendedArm(robot_with(), 'assumed_modes', 2, 0.1)
    simulator = Simulator(arm, noise=Noise(SIGMA, SIGMA / 2000.0), seed=2)
    stepper, n = estimator.stepper, arm.states
    estimator.update(0.0, simulator.measure().output, np.zeros(2))
    h = min((h for h in estimator.bank.hypotheses if h.level == 0),
            key=lambda h: abs(h.mass - 0.1))
    estimator.bank.hypotheses = [h]
    joint = np.zeros((n + 1, n + 1))
    joint[:n, :n], joint[n, n] = h.cov + h.variance * np.outer(h.sens[:, 0], h.sens[:, 0]), \
        h.variance
    joint[:n, n] = joint[n, :n] = h.variance * h.sens[:, 0]
    output = np.hstack([stepper.output, np.zeros((6, 1))])
    for k in range(1, 60):
        command = np.array([np.sin(0.1 * k), np.cos(0.2 * k)])
        simulator.step(command)
        model = linearise(arm.at_payload(h.mass), h.x[None], command[None])
        step = np.eye(n + 1)
        step[:n, :n], step[:n, n] = model.jacobian[0], model.slope[0]
        joint = step @ joint @ step.T
        gain = joint @ output.T @ np.linalg.inv(output @ joint @ output.T + np.eye(6))
        joint = joint - gain @ output @ joint
        estimator.update(robot.sample_time * k, simulator.measure().output, command)
        assert h.variance == pytest.approx(joint[n, n], rel=1e-4)
    total = h.cov + h.variance * np.outer(h.sens[:, 0], h.sens[:, 0])
    np.testing.assert_allclose(total, joint[:n, :n], rtol=1e-3, atol=1e-4 * np.abs(total).max())


def test_zero_order_hold_of_the_increment_loses_no_digits() -> None:
    # What the schedule tabulates: (exp(A T) - I) / T tends to A as T shrinks.
    arm = ExtendedArm(robot_with(), 'assumed_modes', 2)
    a = arm.plant.a[0]
    increment = zero_order_hold(a, a, 1e-9)[1]
    np.testing.assert_allclose(increment / 1e-9, a, atol=1e-5 * np.abs(a).max())
