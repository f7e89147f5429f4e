"""The default estimator at a fast sampling."""

from __future__ import annotations

from dataclasses import replace
import math

from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.estimators.rpe import estimator as rpe
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_payload_estimator.estimators.rpe.time_update import predict
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.payload_profile import PayloadProfile
from flex_plant_sim.simulation.simulator import Noise, Simulator
import numpy as np
import pytest
from rpe_runs import estimator_of, robot_with, Run, square

FAST = replace(robot_with(), sample_time=1e-3)


def test_a_drop_is_found_at_a_fast_sampling() -> None:
    estimator = estimator_of(FAST)
    arm = ExtendedArm(FAST, 'assumed_modes', 2, 0.15)
    run = Run(estimator, PayloadProfile.step(0.15, 3.3, 0.06), 4.5, arm=arm)
    event, = estimator.events
    assert event.time == pytest.approx(3.3, abs=0.06) and event.found <= 3.5
    before, after = 3250, 4500
    for k in (before, after):
        assert abs(run.mass[k] - run.truth[k]) < 4.0 * run.std[k] < 4e-3


@pytest.mark.parametrize('step', [5e-4, 2e-3, 1e-2])
def test_the_sampling_rate_changes_nothing_but_the_noise(step: float) -> None:
    # 200 to 1000 samples of a stiff arm: what is known at 1 s is the bound at any rate.
    robot = replace(robot_with(1e-3 * (1e-2 / step)**0.5), sample_time=step)
    estimator = estimator_of(robot)
    arm = ExtendedArm(robot, 'assumed_modes', 2, 0.12)
    run = Run(estimator, PayloadProfile.constant(0.12), 1.0, arm=arm)
    assert abs(run.mass[-1] - 0.12) < 3.0 * run.std[-1]
    assert run.std[-1] == pytest.approx(1.35e-5, rel=0.3)


def test_the_reduced_model_is_exact_at_a_fast_sampling_too() -> None:
    robot = replace(robot_with(), sample_time=2e-3)
    estimator = make_estimator('rpe', robot, 'paper_reduced', 2)
    assert isinstance(estimator, RecursivePredictionError)
    run = Run(estimator, PayloadProfile.constant(0.12), 2.0,
              arm=ExtendedArm(robot, 'paper_reduced', 2, 0.12))
    assert estimator.incumbent.mode.name == 'exact' and run.estimates[-1].status == 'ok'
    assert abs(run.mass[-1] - 0.12) < 4.0 * run.std[-1] < 1e-3


def samples(seconds: float) -> list[tuple[float, Array, Array]]:
    """Return (time, output, command before) of an arm in motion at a fast sampling."""
    simulator = Simulator(ExtendedArm(FAST, 'assumed_modes', 2, 0.1), None,
                          Noise(FAST.angle_noise, FAST.strain_noise), seed=2)
    command, rows = np.zeros(2), []
    for _ in range(round(seconds / FAST.sample_time)):
        sample = simulator.measure()
        rows.append((sample.time, sample.output, command))
        command = 4.0 * (square(sample.time) - sample.angle)
        simulator.step(command)
    return rows


def test_a_prediction_made_ahead_changes_nothing_at_the_start_either() -> None:
    estimator, rows = estimator_of(FAST), samples(0.25)
    found = []
    for ahead in (False, True):
        estimator.reset()
        masses = []
        for k, row in enumerate(rows):
            masses.append(estimator.update(*row).mass)
            if ahead and k + 1 < len(rows):
                # Now and then the command turns out to be another.
                estimator.prepare(rows[k + 1][2] + (k % 7 == 0))
        found.append(masses)
    assert found[0] == found[1]


@pytest.mark.parametrize('name', ['sf1', 'rpe'])
def test_the_layout_of_the_arrays_does_not_matter(name: str) -> None:
    robot, found = robot_with(), []
    model = 'paper_reduced' if name == 'sf1' else 'assumed_modes'
    for stride in (1, 3):
        estimator = make_estimator(name, robot, model, 2)
        random = np.random.default_rng(5)
        for k in range(30):
            output, command = np.zeros(6 * stride), np.zeros(2 * stride)
            output[::stride] = robot.angle_noise * random.standard_normal(6) * 1e-3
            command[::stride] = random.standard_normal(2)
            command.flags.writeable = stride == 1
            estimate = estimator.update(0.01 * k, output[::stride], command[::stride])
        found.append((estimate.mass, estimate.variance))
    assert found[0] == found[1]


def test_what_a_gap_lacks_is_predicted_together_as_one_by_one(monkeypatch: pytest.MonkeyPatch
                                                              ) -> None:
    """A gap of 47 samples, of which ten at most go together, in motion and at the start."""
    estimator, rows = estimator_of(FAST), samples(0.4)
    found = []
    for together in (rpe.GAP_STEP_S, 0.0):
        monkeypatch.setattr(rpe, 'GAP_STEP_S', together)
        estimator.reset()
        found.append([estimator.update(*row) for k, row in enumerate(rows)
                      if not (100 < k <= 147 or 300 < k <= 347)])
    for one, other in zip(*found):
        assert abs(one.mass - other.mass) < 0.01 * math.sqrt(other.variance)
        assert one.variance == pytest.approx(other.variance, rel=0.01)


@pytest.mark.parametrize('steps', [1, 2, 37])
def test_many_samples_of_a_linear_arm_are_one_power_of_its_matrix(steps: int) -> None:
    random, n = np.random.default_rng(steps), 4
    matrix, over_mass = 0.1 * random.standard_normal((2, n, n + 2))
    x, command, cov = random.standard_normal(n), random.standard_normal(2), np.eye(n)
    found = x.copy(), cov.copy(), np.zeros((n, 2))
    predict(*found, np.zeros(2), np.stack([matrix, over_mass, 0.0 * matrix]).reshape(1, -1),
            np.zeros((0, 1)), 0.0, command, np.zeros((0, 2)), np.ones(2), steps)
    moves, push = np.eye(n) + matrix[:, :n], matrix[:, n:]
    sens = np.zeros(n)
    turned = over_mass @ np.r_[x, command]
    for _ in range(steps):
        x, sens = moves @ x + push @ command, moves @ sens + turned
        cov = moves @ cov @ moves.T + push @ push.T
    assert found[0] == pytest.approx(x, rel=1e-9)
    assert found[1] == pytest.approx(cov, rel=1e-9)
    assert found[2][:, 0] == pytest.approx(sens, rel=1e-9)


def test_jitter_of_the_stamps_makes_no_step_more() -> None:
    # Two stamps may be 1.7 or 0.3 intervals apart.
    found = []
    for jitter in (0.0, 0.35):
        estimator, random = estimator_of(FAST), np.random.default_rng(6)
        for time, output, command in samples(0.5):
            late = jitter * FAST.sample_time * random.uniform(-1.0, 1.0)
            found.append(estimator.update(time + late, output, command).mass)
            estimator.conclude()
    np.testing.assert_allclose(found[500:], found[:500], rtol=0.0, atol=1e-9)
