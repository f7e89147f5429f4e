"""Strain bias: a gauge does not read zero on a straight link."""

from __future__ import annotations

from typing import Any

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.mechanics.gauge import gauge_row
from flex_plant_sim.effects.parameter import Parameter


class StrainBias(Effect):
    """A constant added to the reading of one gauge."""

    identifier = 'strain_bias'
    family = 'sensors'
    explanation = 'The gauge {site} does not read zero on a straight link.'
    parameters = (
        # Ordinary moves bend the reference links to about 1e-4.
        Parameter('bias', 'm/m', 0.0, -1e-3, 1e-3, (-2e-5, 2e-5), 2e-6, 3e-5),)
    sites = 'gauge'
    linear = True

    def on_output(self, output: Array, time: Any, robot: Robot) -> Array:
        """Return the readings with one gauge shifted."""
        return output + self['bias'] * gauge_row(robot, self.site)
