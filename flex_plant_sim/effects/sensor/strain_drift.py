"""Strain drift: the zero of a gauge drifts steadily."""

from __future__ import annotations

from typing import Any

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.mechanics.gauge import gauge_row
from flex_plant_sim.effects.parameter import Parameter
import numpy as np


class StrainDrift(Effect):
    """The reading of one gauge grows linearly with the time since the start of the record."""

    identifier = 'strain_drift'
    family = 'sensors'
    explanation = 'The zero of the gauge {site} drifts steadily (warming up, for example).'
    parameters = (
        # 8e-6 over 40 s where ordinary moves give 1e-4.
        Parameter('drift_per_s', 'm/m/s', 0.0, -1e-4, 1e-4, (-1e-6, 1e-6), 2e-7, 2e-6),)
    sites = 'gauge'
    linear = True

    def on_output(self, output: Array, time: Any, robot: Robot) -> Array:
        """Return the readings with one gauge shifted by drift times time."""
        elapsed = np.asarray(time, dtype=float)[..., None]
        return output + self['drift_per_s'] * elapsed * gauge_row(robot, self.site)
