"""The recursive-prediction-error estimator on arms that are not its model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import json
from pathlib import Path

from flex_payload_estimator.estimators.base import Estimate
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_plant_sim.arm.parts import robot_parts
from flex_plant_sim.arm.robot import EffectSpec, Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects import build, catalogue
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.payload_profile import PayloadProfile
from flex_plant_sim.simulation.simulator import Noise, Simulator
import numpy as np
import pytest
from rpe_runs import estimator_of, robot_with, Run, square


def test_an_arm_with_a_part_off_is_known_to_its_tolerances_only() -> None:
    robot = robot_with()
    stiffer = robot.with_link(1, youngs_modulus=1.03 * robot.links[1].youngs_modulus)
    estimator = estimator_of(robot)
    profile = PayloadProfile.constant(0.15)
    exact = Run(estimator, profile, 3.0)
    off = Run(estimator, profile, 3.0, arm=ExtendedArm(stiffer, 'assumed_modes', 2, 0.15))
    assert exact.std[-1] < 1e-4 and off.std[-1] > 2e-3
    assert abs(off.mass[-1] - 0.15) < 2 * off.std[-1]
    assert not estimator.events


def test_what_only_scales_the_whole_arm_stays_unknown() -> None:
    # Masses, inertias, stiffnesses and drives together: no output shows it.
    robot = robot_with()
    for part in robot_parts(robot):
        if not part.unit and not part.name.startswith(('damping', 'drive_gain', 'length')):
            robot = part.change(robot, 0.01)
    estimator = estimator_of(robot_with())
    run = Run(estimator, PayloadProfile.constant(0.101), 4.0,
              arm=ExtendedArm(robot, 'assumed_modes', 2, 0.101))
    assert run.mass[-1] == pytest.approx(0.1, abs=1e-4)
    assert estimator.stepper.prior.scale_variance**0.5 == pytest.approx(0.0061, abs=2e-4)


@pytest.mark.parametrize('share', [0.0, 1.0])
def test_coriolis_forces_are_found_or_found_absent(share: float) -> None:
    effects = [catalogue()['coriolis_centripetal']('arm', (1.0,))] if share else []
    estimator = estimator_of()
    arm = ExtendedArm(robot_with(), 'assumed_modes', 2, 0.15, effects=effects)
    run = Run(estimator, PayloadProfile.constant(0.15), 2.0, arm=arm)
    assert estimator.incumbent.mode.name == 'exact'
    assert estimator.incumbent.beta[1] == pytest.approx(share, abs=1e-9)
    assert abs(run.mass[-1] - 0.15) < 4.0 * run.std[-1] < 4e-4


class Spoilt:
    """The estimator told spoilt outputs of a simulated arm."""

    def __init__(self, spoil: Callable[[float, Array, np.random.Generator], Array],
                 seconds: float, told: Robot | None = None):
        robot = robot_with()
        self.estimator = estimator_of(told or robot)
        simulator = Simulator(ExtendedArm(robot, 'assumed_modes', 2, 0.15), None,
                              Noise(robot.angle_noise, robot.strain_noise), 5)
        random, command = np.random.default_rng(3), np.zeros(2)
        self.estimates: list[Estimate] = []
        for _ in range(round(seconds / 0.01) + 1):
            sample = simulator.measure()
            output = spoil(sample.time, sample.output.copy(), random)
            self.estimates.append(self.estimator.update(sample.time, output, command))
            command = 4.0 * (square(sample.time) - sample.angle)
            simulator.step(command)
        self.error = np.array([a.mass for a in self.estimates]) - 0.15
        self.std = np.array([a.variance for a in self.estimates])**0.5


@pytest.mark.parametrize(('channel', 'size'), [
    (0, 20.0), (1, -1e3), (0, 1e9), (4, 1.0), (2, -100.0), (5, 1e-2)])
def test_one_absurd_sample_moves_nothing(channel: int, size: float) -> None:
    def spoil(time: float, output: Array, _: np.random.Generator) -> Array:
        output[channel] += size * (abs(time - 3.0) < 1e-6)
        return output
    run = Spoilt(spoil, 4.0)
    assert (np.abs(run.error[300:]) < 4.0 * run.std[300:]).all() and run.std[400] < 1e-4
    assert not run.estimator.events


def test_a_burst_of_noise_is_forgotten() -> None:
    told = np.array([1e-3, 1e-3] + [5e-7] * 4)
    run = Spoilt(lambda time, output, random: output + 50.0 * told * random.standard_normal(6)
                 * (3.0 <= time < 3.5), 6.5)
    assert np.mean(np.abs(run.error[300:]) < 1.96 * run.std[300:]) > 0.9
    assert not run.estimator.events
    # The bound of 6.5 s less 0.5 is 1.03 times that of all: what is left was learnt while the
    # noise fell.
    clean = Spoilt(lambda time, output, _: output, 6.5)
    assert run.std[-1] < 1.25 * clean.std[-1] < 2e-5


def test_a_bias_of_the_gauges_is_found() -> None:
    run = Spoilt(lambda time, output, _: output + np.array([0, 0, 2e-5, -2e-5, 1e-5, 3e-5]), 4.0)
    assert abs(run.error[-1]) < 4.0 * run.std[-1] < 1e-4


@pytest.mark.parametrize('factor', [0.1, 10.0, 50.0])
def test_noise_that_the_robot_file_has_wrong_is_found(factor: float) -> None:
    robot = robot_with()
    told = replace(robot, angle_noise=robot.angle_noise / factor,
                   strain_noise=robot.strain_noise / factor)
    run = Spoilt(lambda time, output, _: output, 6.0, told)
    assert np.mean(np.abs(run.error[300:]) < 1.96 * run.std[300:]) > 0.93
    assert run.std[-1] < 6e-3 and not run.estimator.events
    assert all(found.status != 'input_rejected' for found in run.estimates)


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
    late = estimates[round((time + 2.0) / 0.01)]
    assert abs(late.mass - after) < 2.5 * late.variance**0.5 < 0.15 * after


def test_a_hidden_strain_filter_does_not_look_like_a_change(shared_data: Path) -> None:
    # No mode has it: the payload is wrong, and moves by more than is stated.
    estimator, _, _ = bench_run(shared_data / 'bench', 'case_51e0e063', 24.0)
    assert not estimator.events


@pytest.mark.parametrize('name', ['case_927b6c0b', 'case_271bc6d9'])
def test_under_a_hidden_effect_the_payload_stays_within_its_interval(
        shared_data: Path, name: str) -> None:
    # A delay and a soft link, not told.
    estimator, estimates, _ = bench_run(shared_data / 'bench', name, 24.0)
    assert not estimator.events
    mass = np.array([estimate.mass for estimate in estimates[500:]])
    std = np.array([estimate.variance for estimate in estimates[500:]])**0.5
    assert np.mean(np.abs(mass - mass[-1]) < 1.96 * std) > 0.9
