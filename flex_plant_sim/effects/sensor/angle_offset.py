"""Angle offset: the zero of a joint sensor is not that of the arm."""

from __future__ import annotations

from typing import Any

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Effect, one_hot
from flex_plant_sim.effects.parameter import Parameter


class AngleOffset(Effect):
    """A constant added to one joint angle; without gravity only that of joint 2 is observable."""

    identifier = 'angle_offset'
    family = 'sensors'
    explanation = 'The zero of the angle sensor of {site} is off.'
    parameters = (
        Parameter('offset_rad', 'rad', 0.0, -1.0, 1.0, (-0.5, -0.15, 0.15, 0.5), 0.02, 0.15),)
    sites = 'joint'
    structural = True

    def on_output(self, output: Array, time: Any, robot: Robot) -> Array:
        """Return the readings with one angle shifted."""
        return output + self['offset_rad'] * one_hot(self.index, output.shape[-1])
