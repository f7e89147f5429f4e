"""Part parameters within tolerances: variants of the arm whose difference a variance counts."""

from __future__ import annotations

from functools import lru_cache

from flex_payload_estimator.estimators.rpe.schedule import PayloadSchedule
from flex_plant_sim.arm.parts import robot_parts
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

CHANGE = 1e-3


def variants(arm: ExtendedArm, robot: Robot) -> tuple[list[tuple[ExtendedArm, float]], Array]:
    """
    Return the arms with one changed part each, and all tolerances, strain gains last.

    Parts whose tolerance is zero are left out.
    """
    arms, tolerances = [], []
    for part in robot_parts(robot):
        changed = part.change(robot, CHANGE)
        arms.append((ExtendedArm(changed, arm.model_name, arm.modes, effects=arm.effects,
                                 step=arm.step_time), CHANGE))
        tolerances.append(part.tolerance)
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
