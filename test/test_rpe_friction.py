"""The default estimator told of dry friction, and the variance of that."""

from __future__ import annotations

from dataclasses import replace

from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_payload_estimator.estimators.rpe.friction import brake, clipped_variance
from flex_payload_estimator.estimators.rpe.modes import EXACT
from flex_plant_sim.arm.robot import EffectSpec, Robot
from flex_plant_sim.arm.robot_file import load_robot
import numpy as np
import pytest


def told(level: float, name: str = 'coulomb_friction', **more: float) -> Robot:
    """Return the second robot, told of dry friction of joint 2, N m."""
    effect = EffectSpec(name, 'joint_2', {'level_n_m': level, **more})
    return replace(load_robot('quanser_2dsfl'), effects=(effect,))


@pytest.mark.parametrize('mean, std, low, high', [
    (0.1, 0.3, -0.4, 0.4), (1.0, 0.5, -0.4, 0.4), (-0.3, 2.0, -0.3, 0.5), (3.0, 0.01, -1.0, 1.0)])
def test_a_clipped_normal_number_has_the_variance_of_its_integral(
        mean: float, std: float, low: float, high: float) -> None:
    z = mean + std * np.linspace(-9.0, 9.0, 200001)
    weight = np.exp(-0.5 * ((z - mean) / std)**2)
    weight /= weight.sum()
    clipped = np.clip(z, low, high)
    variance = float(weight @ (clipped - weight @ clipped)**2)
    assert clipped_variance(mean, std, low, high) == pytest.approx(variance, abs=1e-4 * std**2)


@pytest.mark.parametrize('robot', [
    told(0.3), told(0.3, 'presliding_friction', travel_rad=0.005)])
@pytest.mark.parametrize('speed', [0.01, 0.3, 3.0])
def test_a_known_state_brakes_as_the_simulator_does(robot: Robot, speed: float) -> None:
    stepper = RecursivePredictionError(robot, modes=2).stepper
    arm = stepper.effects.arm.at_payload(0.1)
    order, command = arm.form.order, np.array([0.1, -0.05])
    before = np.zeros(arm.states)
    before[[1, 2, order, order + 1]] = 0.2, 1e-3, -0.1, speed
    f, g, e = arm.schedule.at(np.cos(before[1]))
    after = f @ before + g @ command
    kalman = stepper.begin(EXACT, np.zeros(4), 0.1, 0.0)
    kalman.cov[:], kalman.beta_cov[:] = 0.0, 0.0
    kalman.x[:] = arm.apply_free_effects(e, before, after, command, 0.0)
    brake(kalman, arm, e, before, arm.motion(before, command, 0.0))
    expected = arm.apply_effects(e, before, after, command, 0.0)
    assert kalman.x == pytest.approx(expected, abs=1e-12)
    assert not kalman.cov.any()


def test_a_stuck_joint_is_known_no_better_and_a_sliding_one_no_worse() -> None:
    stepper = RecursivePredictionError(told(0.3), modes=2).stepper
    arm = stepper.effects.arm.at_payload(0.1)
    order, force = arm.form.order, arm.schedule.at(1.0)[2]
    for speed, gains in ((0.0, True), (3.0, False)):
        kalman = stepper.begin(EXACT, np.zeros(4), 0.1, 0.0)
        kalman.cov[:], kalman.beta_cov[:] = 1e-4 * np.eye(arm.states), 0.0
        kalman.x[order + 1] = speed
        before = kalman.x.copy()
        brake(kalman, arm, force, before, arm.motion(before, np.zeros(2), 0.0))
        more = kalman.cov[order + 1, order + 1] / 1e-4 - 1.0
        assert more == pytest.approx(1.0, rel=0.05) if gains else abs(more) < 1e-9
