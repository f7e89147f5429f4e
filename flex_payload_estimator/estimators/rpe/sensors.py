"""The sensors' noise as the robot file has it, the recent loads, and the state's prior."""

from __future__ import annotations

from typing import NamedTuple

from flex_payload_estimator.estimators.rpe.compiled_step import DRIVE, MEAN, STRAIN
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np
from scipy.sparse.csgraph import connected_components

# Memory of the loads, s: about a period of the arm.
LOAD_MEMORY_S = 0.3
# Standard deviations of a state of which nothing is known, chosen wide: first mode of a link over
# its length (the next ones, as under a static load, less with the square of their number); joints
# and coordinates that effects add, rad; and their speeds, rad/s.
START_BEND, START_ANGLE, START_SPEED = 0.04, 1.0, 1.0


def told_noise(arm: ExtendedArm) -> Array:
    """Return the robot file's standard deviation of each channel, rad and m/m, (m,)."""
    gauges = len(arm.robot.gauge_names)
    return np.array([arm.robot.angle_noise] * 2 + [arm.robot.strain_noise] * gauges)


def speed_feedback(arm: ExtendedArm) -> Array:
    """Return the commands that hold a joint velocity, over the state, (2, n)."""
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
        size = START_BEND * link.length / np.arange(1, arm.modes + 1)**2
        bend += list(size)
        swing += list(size * link.beam(arm.modes).frequencies)
    extra = 0 if arm.compact else arm.form.order - 2 - 2 * arm.modes
    turning = [] if arm.compact else [START_SPEED] * 2
    spread = np.array([START_ANGLE, START_ANGLE, *bend, *[START_ANGLE] * extra,
                       *turning, *swing, *[START_SPEED] * extra])
    return np.concatenate([spread, _added_spread(arm, spread)])


def _added_spread(arm: ExtendedArm, spread: Array) -> Array:
    """
    Return the standard deviation of the states that lags and filters add, from the others' (e,).

    With A_z, A_zx, B of the added states z, dz/dt = A_z z + A_zx x + B u, these follow slow motion
    by z = -A_z^-1 (A_zx x + B u), with commands of one unit. States of one filter are as uncertain
    as the most uncertain of them: a filtered strain as the strain, in m/m.
    """
    plant, own = arm.plant, spread.size
    among = plant.a[0, own:, own:]
    following = -np.linalg.pinv(among) @ np.hstack([plant.a[0, own:, :own], plant.b[0, own:]])
    found = np.sqrt(following**2 @ np.append(spread, [1.0, 1.0])**2)
    _, filters = connected_components(among != 0.0, directed=False)
    return np.array([found[filters == one].max() for one in filters])


class Loads(NamedTuple):
    """
    Recent mean squares of the gauges' strains and of the drives' net torques.

    A model error is a share of these.

    Attributes
    ----------
    share : float
        Weight of one sample in the exponentially fading means.
    table : Array
        (4, m), rows as in compiled_step.py: mean of each channel, rad and m/m; mean square, zero
        for angles; variance about the mean; in the first two columns, mean square of the net
        torques in the command's unit.

    """

    share: float
    table: Array

    @classmethod
    def none(cls, output: Array, step: float) -> Loads:
        """Return the loads of an arm at rest with outputs (m,) and a sampling time, s."""
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
