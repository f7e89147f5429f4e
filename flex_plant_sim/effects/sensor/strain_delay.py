"""Strain delay: the strain readings are older than the angles logged with them."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.state_space import StateSpace
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.mechanics.delay import whole_samples, with_delayed_outputs
from flex_plant_sim.effects.mechanics.gauge import gauge_places
from flex_plant_sim.effects.parameter import Parameter
import numpy as np
from numpy.typing import NDArray


class StrainDelay(Effect):
    """A delay of a site's gauges."""

    identifier = 'strain_delay'
    family = 'sensors'
    explanation = 'The strain readings of {site} are older than the angles logged with them.'
    parameters = (
        Parameter('delay_s', 's', 0.0, 0.0, 0.2, (0.005, 0.01, 0.02, 0.04, 0.08), 0.003, 0.03),)
    sites = 'amplifier'
    structural = True

    def late(self, robot: Robot) -> tuple[NDArray[np.intp], Effect]:
        """Return the whole samples of the delay, and the fraction that is left."""
        late, _ = super().late(robot)
        whole, rest = whole_samples(self['delay_s'], robot.sample_time)
        late[2 + gauge_places(robot, self.site)] = whole
        return late, StrainDelay(self.site, (rest,))

    def on_state_space(self, plant: StateSpace, robot: Robot) -> StateSpace:
        """Return the plant with three states per gauge; the gauge reads the first of them."""
        rows = 2 + gauge_places(robot, self.site)
        return with_delayed_outputs(plant, rows, self['delay_s'])
