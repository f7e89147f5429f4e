"""Part parameters within tolerances: variants of the arm whose difference a variance counts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

from flex_payload_estimator.estimators.rpe_schedule import PayloadSchedule
from flex_plant_sim.arm_model import Array
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.extended_arm import ExtendedArm
from flex_plant_sim.robot import Robot
import numpy as np

CHANGE = 1e-3


def changed_robots(robot: Robot) -> Iterator[tuple[Robot, float]]:
    """Yield the robot with each part parameter raised by CHANGE, and that part's tolerance."""
    far, tolerance = 1.0 + CHANGE, robot.tolerances
    for j, (link, drive) in enumerate(zip(robot.links, robot.drives)):
        yield robot.with_link(j, youngs_modulus=link.youngs_modulus * far), tolerance.stiffness
        yield robot.with_link(j, damping_ratio=link.damping_ratio * far), tolerance.damping
        yield robot.with_link(j, density=link.density * far), tolerance.link_mass
        yield robot.with_drive(j, inertia=drive.inertia * far), tolerance.drive_inertia
        yield robot.with_drive(j, torque_gain=drive.torque_gain * far), tolerance.drive_gain
        yield robot.with_drive(j, damping=drive.damping * far), tolerance.drive_damping
    yield replace(robot, elbow_mass=robot.elbow_mass * far), tolerance.elbow_mass
    yield replace(robot, elbow_inertia=robot.elbow_inertia * far), tolerance.elbow_inertia


def variants(arm: ExtendedArm, robot: Robot) -> tuple[list[tuple[ExtendedArm, float]], Array]:
    """
    Return the arms with one changed part each, and all tolerances, strain gains last.

    Parts whose tolerance is zero are left out.
    """
    arms, tolerances = [], []
    for changed, tolerance in changed_robots(robot):
        if tolerance > 0.0:
            arms.append((ExtendedArm(changed, arm.model_name, arm.modes, effects=arm.effects,
                                     step=arm.step_time), CHANGE))
            tolerances.append(tolerance)
    gauges = len(robot.gauge_names) if robot.tolerances.strain_gain > 0.0 else 0
    return arms, np.array(tolerances + [robot.tolerances.strain_gain] * gauges)


def gain_columns(outputs: int, parts: int, total: int) -> Array:
    """Return where a strain gain acts: 1 at (gauge, its column), (m, total)."""
    columns = np.zeros((outputs, total))
    for k in range(total - parts):
        columns[2 + k, parts + k] = 1.0
    return columns


@lru_cache(maxsize=4)
def tabulated(robot: Robot, model: str, modes: int, effects: tuple[Effect, ...],
              heaviest: float) -> tuple[PayloadSchedule, Array]:
    """Return the schedule, and the tolerances of its parts; the last few arms are kept."""
    arm = ExtendedArm(robot, model, modes, effects=effects)
    arms, tolerances = variants(arm, robot)
    return PayloadSchedule.of(arm, heaviest, arms), tolerances
