"""The default estimator at a fast sampling: a bank at marks, one filter at every sample."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_payload_estimator.estimators.rpe.stepper import Stepper
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


def test_no_sample_waits_for_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    # The search takes several hundred filter steps; a sample has time for a few.
    steps: list[str] = []
    most: list[int] = []

    def counted(name: str) -> Any:
        real = getattr(Stepper, name)

        def step(*arguments: Any) -> None:
            steps.append(name)
            real(*arguments)
        return step
    for name in ('step', 'correct'):
        monkeypatch.setattr(Stepper, name, counted(name))
    update = RecursivePredictionError.update

    def watched(*arguments: Any) -> Any:
        steps.clear()
        found = update(*arguments)
        most.append(len(steps))
        return found
    monkeypatch.setattr(RecursivePredictionError, 'update', watched)
    estimator = estimator_of(FAST)
    Run(estimator, PayloadProfile.step(0.15, 3.3, 0.06), 3.6,
        arm=ExtendedArm(FAST, 'assumed_modes', 2, 0.15))
    assert len(estimator.events) == 1
    assert sum(most[3300:]) > 300 + 400 and max(most[3000:]) < 16


def test_every_sample_counts_once_one_filter_is_left() -> None:
    # The variance falls with the number of samples, not with that of marks.
    stds = []
    for robot in (FAST, robot_with()):
        estimator = estimator_of(robot)
        arm = ExtendedArm(robot, 'assumed_modes', 2, 0.1)
        run = Run(estimator, PayloadProfile.constant(0.1), 4.0, arm=arm)
        assert len(estimator.bank.hypotheses) == 1
        stds.append(run.std[-1])
    assert 2.0 < stds[1] / stds[0] < 5.0


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


def test_a_prediction_made_ahead_changes_nothing_in_a_bank_either() -> None:
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
    assert len(estimator.bank.hypotheses) > 1
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
