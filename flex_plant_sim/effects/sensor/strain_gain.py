"""Strain gain: a gauge or its amplifier is scaled wrongly."""

from __future__ import annotations

from typing import Any

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Effect, Parameter
from flex_plant_sim.effects.mechanics.gauge import gauge_row


class StrainGain(Effect):
    """A factor on the reading of one gauge."""

    identifier = 'strain_gain'
    family = 'sensors'
    explanation = 'The gauge {site} is scaled wrongly.'
    parameters = (Parameter('factor', '', 1.0, 0.05, 5.0, (0.85, 1.15), 0.03, 0.15),)
    sites = 'gauge'

    def on_output(self, output: Array, time: Any, robot: Robot) -> Array:
        """Return the readings with one gauge scaled."""
        return output * (1.0 + (self['factor'] - 1.0) * gauge_row(robot, self.site))
