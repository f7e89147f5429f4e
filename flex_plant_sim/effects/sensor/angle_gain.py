"""Angle gain: a joint sensor is scaled wrongly."""

from __future__ import annotations

from typing import Any

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Effect, one_hot
from flex_plant_sim.effects.parameter import Parameter


class AngleGain(Effect):
    """A factor on the reading of one joint angle."""

    identifier = 'angle_gain'
    family = 'sensors'
    explanation = 'The angle sensor of {site} is scaled wrongly.'
    parameters = (Parameter('factor', '', 1.0, 0.2, 3.0, (0.75, 0.94, 1.06, 1.45), 0.01, 0.1),)
    sites = 'joint'
    structural = True

    def on_output(self, output: Array, time: Any, robot: Robot) -> Array:
        """Return the readings with one angle scaled."""
        return output * (1.0 + (self['factor'] - 1.0) * one_hot(self.index, output.shape[-1]))
