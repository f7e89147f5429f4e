"""The recursive-prediction-error estimator on arms that are not its model."""

from __future__ import annotations

from dataclasses import replace
import json
from pathlib import Path

from flex_payload_estimator.estimators.base import Estimate
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_payload_estimator.estimators.rpe.kernel import MASS_COLUMNS
from flex_plant_sim.arm.robot import EffectSpec
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.effects import build
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.payload_profile import PayloadProfile
import numpy as np
import pytest
from rpe_runs import estimator_of, robot_with, Run


def test_tolerances_widen_the_interval_only_where_the_model_does_not_fit() -> None:
    robot = robot_with()
    stiffer = robot.with_link(1, youngs_modulus=1.03 * robot.links[1].youngs_modulus)
    estimator = estimator_of(robot)
    profile = PayloadProfile.constant(0.15)
    exact = Run(estimator, profile, 3.0)
    off = Run(estimator, profile, 3.0, arm=ExtendedArm(stiffer, 'assumed_modes', 2, 0.15))
    assert exact.std[-1] < 1e-4 and off.std[-1] > 3e-3
    assert abs(off.mass[-1] - 0.15) < 2 * off.std[-1]


def test_the_lean_is_the_effect_of_a_part_on_the_estimate() -> None:
    robot = robot_with(1e-4)
    estimator, profile = estimator_of(robot), PayloadProfile.constant(0.15)
    masses = []
    for change in (0.005, -0.005):
        other = robot.with_link(0, youngs_modulus=(1 + change) * robot.links[0].youngs_modulus)
        run = Run(estimator, profile, 4.0, arm=ExtendedArm(other, 'assumed_modes', 2, 0.15))
        masses.append(run.mass[-1])
    h = estimator.bank.best()
    assert not estimator.stepper.levels[h.level].exact and h.sens.shape[1] > MASS_COLUMNS
    # lean = d(m - estimate)/d(part); the stiffness of the upper link is the first part.
    assert (masses[1] - masses[0]) / 0.01 == pytest.approx(h.lean[0], rel=0.05)


@pytest.mark.parametrize('spec', [
    EffectSpec('coulomb_friction', 'joint_2', {'level_n_m': 0.4}),
    EffectSpec('input_delay', 'arm', {'delay_s': 0.03}),
    EffectSpec('strain_filter', 'arm', {'time_constant_s': 0.04, 'damping': 0.8}),
    EffectSpec('strain_gain', 'strain_2a', {'factor': 0.8})])
def test_the_effects_of_a_robot_file_are_used(spec: EffectSpec) -> None:
    robot = robot_with()
    extended = replace(robot, effects=(spec,))
    arm = ExtendedArm(robot, 'assumed_modes', 2, 0.15, effects=[build(spec, robot)])
    profile = PayloadProfile.constant(0.15)
    knowing = Run(estimator_of(extended), profile, 3.0, arm=arm)
    ignorant = Run(estimator_of(robot), profile, 3.0, arm=arm)
    assert abs(knowing.mass[-1] - 0.15) < 4 * knowing.std[-1] < 4e-3
    assert abs(ignorant.mass[-1] - 0.15) > 2 * abs(knowing.mass[-1] - 0.15)


def bench_run(folder: Path, name: str, seconds: float) -> tuple[
        RecursivePredictionError, list[Estimate], dict[str, object]]:
    """Return the default estimator's answers to the first seconds of a record."""
    truth = json.loads((folder / 'truth.json').read_text())[name]
    rows = np.loadtxt(folder / f'{name}.csv', delimiter=',', skiprows=1,
                      max_rows=round(seconds / 0.01) + 1)
    estimator = RecursivePredictionError(load_robot('reference'))
    command, estimates = np.zeros(2), []
    for row in rows:
        estimates.append(estimator.update(row[0], row[3:9], command))
        command = row[1:3]
    return estimator, estimates, truth


def test_on_the_clean_record_of_another_simulator(shared_data: Path) -> None:
    estimator, estimates, truth = bench_run(shared_data / 'bench', 'case_8009d8b8', 10.0)
    true = truth['payload_true']
    assert isinstance(true, float) and not estimator.events
    assert abs(estimates[300].mass / true - 1) < 0.06
    assert abs(estimates[1000].mass / true - 1) < 0.03
    assert abs(estimates[1000].mass - true) < 1.96 * estimates[1000].variance**0.5


def test_on_the_record_with_a_drop(shared_data: Path) -> None:
    estimator, estimates, truth = bench_run(shared_data / 'bench', 'case_76be4577', 14.0)
    effect = truth['effect']
    assert isinstance(effect, dict)
    time, after = effect['payload_drop']
    event, = estimator.events
    assert abs(event.time - time) < 0.1 and time <= event.found < time + 0.2
    assert abs(estimates[round((time + 2.0) / 0.01)].mass / after - 1) < 0.05


@pytest.mark.parametrize('name', ['case_51e0e063', 'case_927b6c0b', 'case_271bc6d9'])
def test_a_hidden_effect_does_not_look_like_a_change(shared_data: Path, name: str) -> None:
    # A strain filter, a delay and a soft link, none of them told.
    estimator, estimates, _ = bench_run(shared_data / 'bench', name, 40.0)
    assert not estimator.events
    late = np.array([estimate.mass for estimate in estimates[-1000:]])
    assert np.abs(np.diff(late)).max() < 0.05 * late.mean()
