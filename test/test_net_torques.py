"""What every model may miss of a joint's torque is a share of what its drive exerts on the arm."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.drive import Drive
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.diagnosis.prediction.process_noise import net_torques
from flex_plant_sim.diagnosis.record.windows import Record, Windows
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np
import pytest
from simulated_records import REFERENCE

STEP, INERTIA, TIME_CONSTANT = 0.01, 0.3, 0.05
TORQUE, RATE = 0.4, 2.0


def arm_and_windows(noise: float) -> tuple[ExtendedArm, Windows]:
    """Return an arm with velocity loops whose drives exert TORQUE sin(RATE t), and its windows."""
    drive = Drive.velocity_loop(INERTIA, TIME_CONSTANT, 1.0)
    robot: Robot = replace(REFERENCE, drives=(drive, drive))
    time = np.linspace(0.0, 4000 * STEP, 4001)
    # A rigid joint of that inertia: theta'' = tau / J, from rest.
    speed = TORQUE / INERTIA / RATE * (1.0 - np.cos(RATE * time))
    angle = TORQUE / INERTIA / RATE * (time - np.sin(RATE * time) / RATE)
    middle = time + 0.5 * STEP
    # u holds from one sample to the next, so that the drive exerts what it should in the middle.
    command = (TORQUE * np.sin(RATE * middle) + drive.damping * TORQUE / INERTIA / RATE
               * (1.0 - np.cos(RATE * middle))) / drive.torque_gain
    assert np.std(drive.torque_gain * command) > 4.0 * TORQUE and np.ptp(speed) > 1.0
    random = np.random.default_rng(1)
    output = np.column_stack([angle, angle, *[np.zeros_like(time)] * 4])
    output[:, :2] += noise * random.standard_normal((len(time), 2))
    return ExtendedArm(robot, 'assumed_modes', 2, 0.1), Windows.cut(Record(
        'made', time, np.column_stack([command, command]), output, 0.1), 2.0 * np.pi, STEP)[0]


@pytest.mark.parametrize('noise', [0.0, 1e-4])
def test_net_torque_of_a_velocity_loop_is_what_turns_the_joint(noise: float) -> None:
    arm, windows = arm_and_windows(noise)
    # A tenth of a second averages little of a sine of 2 rad/s.
    assert net_torques(arm, windows) == pytest.approx([TORQUE / np.sqrt(2.0)] * 2, rel=0.02)
