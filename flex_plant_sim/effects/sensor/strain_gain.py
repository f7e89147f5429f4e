"""Strain gain: a gauge or its amplifier is scaled wrongly."""

from __future__ import annotations

from typing import Any

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.mechanics.gauge import gauge_row
from flex_plant_sim.effects.parameter import Parameter
import numpy as np


class StrainGain(Effect):
    """A factor on the reading of one gauge, which may creep (a supply, an adhesive that warms)."""

    identifier = 'strain_gain'
    family = 'sensors'
    explanation = 'The gauge {site} is scaled wrongly.'
    parameters = (
        Parameter('factor', '', 1.0, 0.05, 5.0, (0.5, 0.85, 1.15, 2.1), 0.03, 0.15),
        # As much over a record of 40 s as a wrong scale may be from its start.
        Parameter('creep_per_s', '1/s', 0.0, -0.1, 0.1, (-0.004, 0.004), 0.0008, 0.004,
                  optional=True))
    sites = 'gauge'

    def on_output(self, output: Array, time: Any, robot: Robot) -> Array:
        """Return the readings with one gauge scaled, by a factor linear in time."""
        elapsed = np.asarray(time, dtype=float)[..., None]
        excess = self['factor'] - 1.0 + self['creep_per_s'] * elapsed
        return output * (1.0 + excess * gauge_row(robot, self.site))
