"""What the sensors are told to be, what they carry now, and where the arm may be at the start."""

from __future__ import annotations

from typing import NamedTuple

from flex_payload_estimator.estimators.rpe.compiled_step import DRIVE, MEAN, STRAIN
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

# Loads are remembered this long, s: about a period of the arm.
LOAD_MEMORY_S = 0.3


def told_noise(arm: ExtendedArm) -> Array:
    """Return the robot file's standard deviation of each channel, rad and m/m, (m,)."""
    gauges = len(arm.robot.gauge_names)
    return np.array([arm.robot.angle_noise] * 2 + [arm.robot.strain_noise] * gauges)


def speed_feedback(arm: ExtendedArm) -> Array:
    """Return the command that holds a joint velocity of 1 rad/s, over the states, (2, n)."""
    rows = np.zeros((2, arm.states))
    if arm.compact is None:
        for j, drive in enumerate(arm.robot.drives):
            rows[j, arm.form.order + j] = drive.damping / drive.torque_gain
    return rows


def start_spread(arm: ExtendedArm) -> Array:
    """Return the standard deviation of the state at the start: anywhere, moving, bent, (n,)."""
    bend: list[float] = []
    swing: list[float] = []
    for link in arm.robot.links:
        size = 0.04 * link.length / np.arange(1, arm.modes + 1)**2
        bend += list(size)
        swing += list(size * link.beam(arm.modes).frequencies)
    extra = [1.0] * (0 if arm.compact else arm.form.order - 2 - 2 * arm.modes)
    turning = [] if arm.compact else [1.0, 1.0]
    spread = [1.0, 1.0, *bend, *extra, *turning, *swing, *extra]
    return np.array(spread + [1.0] * (arm.states - len(spread)))


class Loads(NamedTuple):
    """
    Mean squares of what the gauges see and of the drives' net torques, remembered for a while.

    Attributes
    ----------
    share : float
        What a sample counts.
    table : Array
        Rows, (4, m): mean of each channel, rad and m/m; mean square, zero for angles; variance
        about the mean; of the first two columns, net torques in the command's unit, squared.

    """

    share: float
    table: Array

    @classmethod
    def none(cls, output: Array, step: float) -> Loads:
        """Return those of an arm at rest whose channels read what they read, (m,)."""
        table = np.zeros((4, output.size))
        table[MEAN] = output
        return cls(min(1.0, step / LOAD_MEMORY_S), table)

    @property
    def strain(self) -> Array:
        """Return the mean square of each channel, m/m squared, zero for angles, (m,)."""
        return self.table[STRAIN]

    @property
    def drive(self) -> Array:
        """Return the mean square of the net torques in the command's unit, (2,)."""
        return self.table[DRIVE, :2]
