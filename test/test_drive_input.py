"""From a command to the drive: the same for all that predict, and sample by sample as at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects import effects_of, parse
from flex_plant_sim.simulation.drive_input import DriveInput
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Simulator
import numpy as np
import pytest
from simulated_records import REFERENCE

LIMIT, STEP = 0.7, REFERENCE.sample_time
TEXTS = ('input_delay:arm:delay_s=0.025', 'actuator_gain:joint_2:factor=1.3',
         'actuator_dead_zone:joint_1:half_width=0.1')
DELAYS = ('input_delay:arm:delay_s=0.025', 'input_delay:joint_2:delay_s=0.01')


def limited(*texts: str) -> Robot:
    """Return the reference robot whose drives obey no more than LIMIT, with effects."""
    robot = REFERENCE.with_drive(0, command_limit=LIMIT).with_drive(1, command_limit=LIMIT)
    return replace(robot, effects=tuple(map(parse, texts)))


def extended(robot: Robot) -> ExtendedArm:
    """Return a robot's arm with the effects of its file."""
    return ExtendedArm(robot, effects=effects_of(robot))


def by_hand(commands: Array, texts: tuple[str, ...]) -> Array:
    """Return the commands that the drives apply, (N, 2), as the effects' explanations say."""
    applied = np.clip(commands, -LIMIT, LIMIT)
    samples = np.arange(-1.0, len(commands))
    for text in texts:
        name, site, value = text.split(':')
        size = float(value.partition('=')[2])
        for joint in [0, 1] if site == 'arm' else [int(site[-1]) - 1]:
            one = np.append(0.0, applied[:, joint])
            made = {'input_delay': np.interp(samples - size / STEP, samples, one),
                    'actuator_gain': size * one,
                    'actuator_dead_zone': np.sign(one) * np.maximum(np.abs(one) - size, 0.0)}
            applied[:, joint] = made[name][1:]
    return applied


def of_simulator(robot: Robot, commands: Array) -> Array:
    """Return what the simulator's drives apply, (N, 2)."""
    more = np.vstack([commands, commands[:1]])
    return Simulator(extended(robot)).advance(more, np.zeros((len(more), 2)))[1][1:]


def of_samples(robot: Robot, commands: Array) -> Array:
    """Return what a DriveInput makes of one command after the other, (N, 2)."""
    live = DriveInput(extended(robot))
    return np.array([live(command, STEP * k) for k, command in enumerate(commands)])


def of_diagnosis(robot: Robot, commands: Array) -> Array:
    """Return what the predictors of the diagnosis take for applied, (N, 2)."""
    time = STEP * np.arange(float(len(commands)))
    return DriveInput(extended(robot)).of_record(commands, time)[:, 0]


def of_rpe(robot: Robot, commands: Array) -> Array:
    """Return what `rpe` takes for applied, (N, 2), that is told wrongly of each sample first."""
    estimator = RecursivePredictionError(robot, 'assumed_modes', 1)
    output, found = np.zeros(2 + len(robot.gauge_names)), []
    estimator.update(0.0, output, np.zeros(2))
    for k, command in enumerate(commands):
        estimator.prepare(command + 0.1)
        estimator.update(STEP * (k + 1), output, command)
        assert estimator._unconcluded is not None
        found.append(estimator._unconcluded.command)
    return np.array(found)


@pytest.mark.parametrize('texts', [(), TEXTS[:1], TEXTS, DELAYS])
@pytest.mark.parametrize('user', [of_simulator, of_samples, of_diagnosis, of_rpe])
def test_a_drive_applies_what_the_effects_in_a_row_make_of_what_it_obeys(
        user: Callable[[Robot, Array], Array], texts: tuple[str, ...]) -> None:
    commands = np.random.default_rng(2).normal(0.0, 3.0, (50, 2))
    found = user(limited(*texts), commands)
    assert found == pytest.approx(by_hand(commands, texts), abs=1e-12)


def test_a_late_command_is_one_that_the_drive_obeyed() -> None:
    arm = extended(limited('input_delay:arm:delay_s=0.025'))
    reached = DriveInput(arm).of_record(np.full((20, 2), 3.0), STEP * np.arange(20.0))[:, 0, 0]
    # Two and a half samples late, in the mean over a sample; never more than the limit.
    assert reached == pytest.approx([0.0, 0.0, 0.35] + [LIMIT] * 17)
