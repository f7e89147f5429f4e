"""The recursive-prediction-error estimator: derivatives, covariance, bound."""

from __future__ import annotations

from dataclasses import replace

from cramer_rao import linearise, payload_bound
from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_payload_estimator.estimators.rpe.filter import Filter, Sample
from flex_payload_estimator.estimators.rpe.modes import ROUGH
from flex_payload_estimator.estimators.rpe.prior import tabulated
from flex_payload_estimator.estimators.rpe.sensors import Loads, start_spread
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.arm.state_space import zero_order_hold
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.payload_profile import PayloadProfile
import numpy as np
import pytest
from rpe_runs import estimator_of, robot_with, Run


def test_the_schedule_and_its_derivatives_are_those_of_the_sampled_arm() -> None:
    robot = robot_with()
    schedule = tabulated(replace(robot, angle_noise=1.0, strain_noise=1.0), 'assumed_modes', 2,
                         (), 0.7)
    arm = ExtendedArm(robot, 'assumed_modes', 2)

    def exact(angle: float, mass: float) -> Array:
        f, g, _ = arm.matrices(np.cos(angle), mass)
        return np.hstack([f - np.eye(len(f)), g])

    n = arm.states
    for angle, mass in ((0.3, 0.0003), (1.9, 0.1), (2.9, 0.35), (0.0, 0.69)):
        piece = schedule.cut(mass)
        away, wave = mass - piece.payload, np.cos(angle * np.arange(len(piece.series)))
        value, slope, bend = (wave @ piece.series).reshape(3, -1)
        found = (value + away * (slope + 0.5 * away * bend)).reshape(n, -1)
        size = np.abs(exact(angle, mass)).max()
        np.testing.assert_allclose(found[:, :n + 2], exact(angle, mass), atol=3e-7 * size)
        over_mass = (exact(angle, mass + 1e-6) - exact(angle, mass - 1e-6 * (mass > 0))) / (
            1e-6 * (1 + (mass > 0)))
        np.testing.assert_allclose((slope + away * bend).reshape(n, -1)[:, :n + 2], over_mass,
                                   atol=5e-4 * np.abs(over_mass).max())


def joint(f: Filter) -> Array:
    """Return the covariance of (x, beta) from its factors."""
    cross = f.sensitivity @ f.beta_cov
    return np.block([[f.cov + cross @ f.sensitivity.T, cross], [cross.T, f.beta_cov]])


def anywhere(estimator: RecursivePredictionError) -> Filter:
    """Return a filter with parts, in motion, whose factors are arbitrary."""
    random = np.random.default_rng(4)
    f = estimator.stepper.begin(ROUGH, np.array([0.2, 0.9, 0.0, 0.0, 0.0, 0.0]), 0.12, 0.05)
    n, size = f.x.size, f.beta.size
    spread = np.sqrt(np.diag(f.cov))
    f.x += 0.1 * spread * random.standard_normal(n)
    f.x[1] = 0.9
    f.beta += 0.3 * np.sqrt(np.diag(f.beta_cov)) * random.standard_normal(size)
    f.sensitivity[:] = np.outer(spread, 1.0 / np.sqrt(np.diag(f.beta_cov))) \
        * random.standard_normal((n, size))
    return f


def test_a_prediction_moves_the_joint_covariance_by_its_own_derivatives() -> None:
    stepper, loads = (estimator := estimator_of()).stepper, Loads.none(np.zeros(6), 0.01)
    f, sample = anywhere(estimator), Sample(0.0, None, np.array([0.5, -0.4]))
    n, size = f.x.size, f.beta.size
    move = np.eye(n + size)

    def predicted(change: Array) -> Array:
        g = f.copy()
        g.x[:], g.beta[:] = f.x + change[:n], f.beta + change[n:]
        stepper.predict(g, sample, loads)
        return g.x

    for k in range(n + size):
        step = 1e-4 * np.sqrt(joint(f)[k, k]) * np.eye(n + size)[k]
        move[:n, k] = (predicted(step) - predicted(-step)) / (2.0 * step[k])
    after = f.copy()
    after.mode = f.mode._replace(drive_error=0.0)
    stepper.predict(after, sample, loads)
    # What a wrong model says of the parts fades: not what is tested here.
    after.beta_cov[:] = f.beta_cov
    expected, found = move @ joint(f) @ move.T, joint(after)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(scale, scale),
                               expected / np.outer(scale, scale), atol=0.02)


def test_a_walk_and_a_measurement_are_those_of_the_augmented_kalman_filter() -> None:
    stepper = (estimator := estimator_of()).stepper
    f = anywhere(estimator)
    f.mode = f.mode._replace(gauge_error=0.0)
    n, size, gauges = f.x.size, f.beta.size, 4
    expected = joint(f)
    expected[n, n] += 0.02**2
    stepper.drift(f, 0.02**2)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(joint(f) / np.outer(scale, scale),
                               expected / np.outer(scale, scale), atol=1e-9)
    output = np.zeros((6, n + size))
    output[:, :n] = stepper.output * (1.0 + np.r_[0.0, 0.0, f.beta[-gauges:]])[:, None]
    output[2:, n + 2:n + 2 + gauges] = np.eye(gauges)
    output[2:, -gauges:] = np.diag((stepper.output @ f.x)[2:])
    output[1, n + 2 + gauges] = 1.0
    expect = output[:, :n] @ f.x + np.r_[0.0, f.beta[6], f.beta[2:6]]
    total = output @ expected @ output.T + np.diag(stepper.told_variance)
    gain = expected @ output.T @ np.linalg.inv(total)
    measured = expect + 0.1 * np.sqrt(np.diag(total))
    x, beta = f.x.copy(), f.beta.copy()
    stepper.correct(f, Sample(0.0, measured, np.zeros(2)), Loads.none(np.zeros(6), 0.01))
    moved = np.r_[f.x - x, f.beta - beta]
    np.testing.assert_allclose(moved / scale, gain @ (measured - expect) / scale, atol=1e-7)
    np.testing.assert_allclose(
        joint(f) / np.outer(scale, scale),
        (expected - gain @ total @ gain.T) / np.outer(scale, scale), atol=1e-7)


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
        # The noise is estimated from the last half second, a hundred readings of the angles.
        assert run.std[-1] == pytest.approx(bound[-1], rel=0.15)
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
    f = estimator.incumbent
    for cov in (f.cov, f.beta_cov):
        scale = np.sqrt(np.diag(cov))
        assert np.array_equal(cov, cov.T)
        assert np.linalg.eigvalsh(cov / np.outer(scale, scale)).min() > 0.0
    assert abs(run.mass[-1] - 0.1) < 4 * run.std[-1]


def test_zero_order_hold_of_the_increment_loses_no_digits() -> None:
    # What the schedule tabulates: (exp(A T) - I) / T tends to A as T shrinks.
    arm = ExtendedArm(robot_with(), 'assumed_modes', 2)
    a = arm.plant.a[0]
    increment = zero_order_hold(a, a, 1e-9)[1]
    np.testing.assert_allclose(increment / 1e-9, a, atol=1e-5 * np.abs(a).max())
