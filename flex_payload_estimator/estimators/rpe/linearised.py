"""The sampled arm and its derivatives about one payload, and parts beside the robot file's."""

from __future__ import annotations

from dataclasses import dataclass, field

from flex_payload_estimator.estimators.rpe.forces import motion_rows
from flex_payload_estimator.estimators.rpe.schedule import (
    ANGLE_TERMS,
    at_angle,
    BoundedCache,
    CACHED_PARTS,
    COARSE_TERMS,
    coefficients,
    PART_ANGLE,
    PayloadSchedule,
)
from flex_payload_estimator.estimators.rpe.time_update import MASS
from flex_plant_sim.arm.parts import Part
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

# Steps of finite differences: over the payload as a share of (m + soft mass), over a part as a
# share of its tolerance. Their remainders are 1e-4 of a derivative, their rounding 1e-10.
MASS_STEP, PART_SHARE = 0.01, 0.02


@dataclass(frozen=True)
class LinearisedModel:
    """
    The model about one payload and one set of parts.

    Attributes
    ----------
    reference : Array
        The parameters, (B,).
    nominal : Array
        The same with parts that do not deviate, because `series` has the deviations, (B,).
    series : Array
        T [A B E] and its derivatives over the payload, see schedule.PayloadSlice; the second
        derivative does not count, for the payload is fixed.
    parts : Array
        Derivatives of T [A B] over the parts, as cosine series over the angle,
        (K', p n (n + 2)).
    count : int
        Number of parts, p.
    motion : Array
        See forces.motion_rows.

    """

    reference: Array
    nominal: Array
    series: Array
    parts: Array
    count: int
    motion: Array
    angles: BoundedCache = field(default_factory=lambda: BoundedCache(CACHED_PARTS))

    def parts_at(self, angle: float) -> Array:
        """Return derivatives over the parts at an angle, rad: (p, n (n + 2))."""
        turn = round(angle / PART_ANGLE)
        found: Array = self.angles.get(turn, lambda: at_angle(self.parts, turn, self.count))
        return found


@dataclass(frozen=True)
class Lineariser:
    """
    Makes models about other parts.

    Attributes
    ----------
    robot : Robot
        The robot file's.
    parts : tuple of Part
        In the order of their parameters.
    first : int
        Index of the first one among the parameters.
    model, modes, effects
        As of ExtendedArm.
    soft_mass : float
        kg.

    """

    robot: Robot
    parts: tuple[Part, ...]
    first: int
    model: str
    modes: int
    effects: tuple[Effect, ...]
    soft_mass: float

    def model_about(self, reference: Array) -> LinearisedModel:
        """Return the model about parameters, (B,)."""
        columns = slice(self.first, self.first + len(self.parts))
        deviations, mass = reference[columns], max(float(reference[MASS]), 0.0)
        robot, step = self._robot(deviations), MASS_STEP * (mass + self.soft_mass)
        arm = self._arm(robot)
        low = max(mass - step, 0.0)
        value, above, below = coefficients(
            arm, ANGLE_TERMS, np.array([mass, mass + step, low])).reshape(3, ANGLE_TERMS, -1)
        slope = (above - below) / (mass + step - low)
        base = coefficients(arm, COARSE_TERMS, np.array([mass]), forces=False)
        rows = self._slopes(robot, base, mass)
        nominal = reference.copy()
        nominal[columns] = 0.0
        return LinearisedModel(reference, nominal, np.hstack([value, slope, 0.0 * slope]), rows,
                               len(self.parts), motion_rows(arm))

    def _slopes(self, robot: Robot, base: Array, mass: float) -> Array:
        """Return the derivatives over the parts, (K', p n (n + 2))."""
        rows = np.empty((COARSE_TERMS, len(self.parts), base.size // COARSE_TERMS))
        for k, part in enumerate(self.parts):
            step = PART_SHARE * part.tolerance
            arm = self._arm(part.change(robot, step))
            found = coefficients(arm, COARSE_TERMS, np.array([mass]), forces=False)
            rows[:, k] = (found - base).reshape(COARSE_TERMS, -1) / step
        return rows.reshape(COARSE_TERMS, rows[0].size)

    def _robot(self, deviations: Array) -> Robot:
        robot = self.robot
        for part, deviation in zip(self.parts, deviations.tolist()):
            robot = part.change(robot, deviation)
        return robot

    def _arm(self, robot: Robot) -> ExtendedArm:
        return ExtendedArm(robot, self.model, self.modes, effects=self.effects,
                           step=self.robot.sample_time)


def at_payload(schedule: PayloadSchedule, reference: Array, motion: Array, free_parts: bool
               ) -> LinearisedModel:
    """
    Return the model of the robot file's parts about parameters.

    Parameters
    ----------
    schedule : PayloadSchedule
        The robot file's arm.
    reference : Array
        The parameters, (B,).
    motion : Array
        See forces.motion_rows.
    free_parts : bool
        Whether parts are among the parameters.

    """
    payload = max(float(reference[MASS]), 0.0)
    piece = schedule.cut(payload)
    away, (value, slope, bend) = float(reference[MASS]) - piece.payload, np.split(
        piece.series, 3, axis=1)
    series = np.hstack([value + away * (slope + 0.5 * away * bend), slope + away * bend, bend])
    parts, count = (schedule.part_layers_at(payload), schedule.parameters) if free_parts \
        else (np.zeros((0, 1)), 0)
    return LinearisedModel(reference, reference, series, parts, count, motion)
