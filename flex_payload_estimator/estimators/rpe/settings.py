"""Settings of the recursive-prediction-error estimator, and its model of a robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from flex_payload_estimator.estimators.base import largest_payload
from flex_payload_estimator.estimators.rpe.effects import EffectStep
from flex_payload_estimator.estimators.rpe.filter_step import FilterStep
from flex_payload_estimator.estimators.rpe.forces import motion_rows, moves
from flex_payload_estimator.estimators.rpe.linearised import Lineariser
from flex_payload_estimator.estimators.rpe.prior import (
    CERTAIN,
    moving_parts,
    prior_of,
    tabulated,
)
from flex_payload_estimator.estimators.rpe.sensors import start_spread, told_noise
from flex_payload_estimator.estimators.rpe.time_update import DISTURBANCES, FIRST_BIAS
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.structure.coriolis_centripetal import CoriolisCentripetal
from flex_plant_sim.effects.structure.foreshortening import Foreshortening
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from msg_config.errors import InputError
import numpy as np


@dataclass(frozen=True)
class RpeSettings:
    """
    Choices beyond the robot file.

    Attributes
    ----------
    payload_max : float or None
        Largest payload, kg, at least CERTAIN; None takes base.largest_payload.
    torque_noise : tuple of float
        Told process noise: standard deviation of a torque on each joint, held over a sample, N m.

    """

    payload_max: float | None = None
    torque_noise: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        """Validate."""
        if self.payload_max is not None and not self.payload_max >= CERTAIN:
            raise InputError(f'payload_max: expected a number >= {CERTAIN:g} kg, '
                             f'got {self.payload_max!r}')
        if min(self.torque_noise) < 0.0:
            raise InputError(f'torque_noise: expected numbers >= 0, got {self.torque_noise}')


def stepper_of(robot: Robot, model: str, modes: int, effects: Sequence[Effect],
               settings: RpeSettings) -> FilterStep:
    """
    Return the model of a robot that steps its filters.

    The forces of motion are no effect here but parameters: rigid links' as the simulator has them
    if the robot file names no more, and those with bending links, which real arms have.
    """
    others = tuple(e for e in effects
                   if not isinstance(e, (CoriolisCentripetal, Foreshortening)))
    bent = any(isinstance(e, Foreshortening) for e in effects)
    arm = ExtendedArm(robot, model, modes, effects=others)
    payload_max = largest_payload(robot, settings.payload_max)
    bare = replace(robot, effects=(), angle_noise=1.0, strain_noise=1.0)
    schedule = tabulated(bare, model, modes, others, payload_max)
    motion = motion_rows(arm, bent), motion_rows(arm)
    gains = np.array([drive.torque_gain for drive in robot.drives])
    first = FIRST_BIAS + len(robot.gauge_names) + 1 + DISTURBANCES
    lineariser = Lineariser(bare, moving_parts(robot), first, model, modes, others,
                            schedule.soft_mass)
    return FilterStep(schedule, motion, lineariser, prior_of(robot, effects, moves(arm)),
                      EffectStep(arm), told_noise(arm), np.asarray(settings.torque_noise) / gains,
                      payload_max, start_spread(arm))
