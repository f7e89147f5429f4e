"""From a command to the drive: the same sample by sample and for a whole record."""

from __future__ import annotations

from flex_plant_sim.simulation.drive_input import DriveInput
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Simulator
import numpy as np
import pytest
from simulated_records import effects, REFERENCE

TEXTS = ('input_delay:arm:delay_s=0.025', 'actuator_gain:joint_2:factor=1.3',
         'actuator_dead_zone:joint_1:half_width=0.1')


def limited(*texts: str) -> ExtendedArm:
    """Return the reference arm whose drives obey no more than 0.7, with effects."""
    robot = REFERENCE.with_drive(0, command_limit=0.7).with_drive(1, command_limit=0.7)
    return ExtendedArm(robot, effects=effects(*texts))


@pytest.mark.parametrize('texts', [(), TEXTS[:1], TEXTS])
def test_a_record_reaches_the_drive_as_its_samples_do(texts: tuple[str, ...]) -> None:
    arm, rng = limited(*texts), np.random.default_rng(2)
    commands, time = rng.uniform(-3.0, 3.0, (50, 2)), 0.01 * np.arange(50.0)
    live, simulator = DriveInput(arm), Simulator(arm)
    simulated = simulator.advance(np.vstack([commands, commands[:1]]), np.zeros((51, 2)))[1][1:]
    assert np.array([live(u, t) for u, t in zip(commands, time)]) == pytest.approx(simulated)
    assert live.of_record(commands, time)[:, 0] == pytest.approx(simulated)


def test_a_late_command_is_one_that_the_drive_obeyed() -> None:
    arm = limited('input_delay:arm:delay_s=0.025')
    reached = DriveInput(arm).of_record(np.full((20, 2), 3.0), 0.01 * np.arange(20.0))[:, 0, 0]
    # Two and a half samples late, in the mean over a sample; never more than the limit.
    assert reached == pytest.approx([0.0, 0.0, 0.35] + [0.7] * 17)
