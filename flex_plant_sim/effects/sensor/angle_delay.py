"""Angle delay: the angle of a joint is older than the other readings logged with it."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.state_space import StateSpace
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.mechanics.delay import whole_samples, with_delayed_outputs
from flex_plant_sim.effects.parameter import Parameter
import numpy as np
from numpy.typing import NDArray


class AngleDelay(Effect):
    """A delay of one joint's angle, as of an encoder behind a slow bus; the drive is not late."""

    identifier = 'angle_delay'
    family = 'sensors'
    explanation = 'The angle of {site} is older than the other readings logged with it.'
    parameters = (
        Parameter('delay_s', 's', 0.0, 0.0, 0.2, (0.005, 0.01, 0.02, 0.03, 0.05), 0.003, 0.03),)
    sites = 'joint'
    structural = True

    def late(self, robot: Robot) -> tuple[NDArray[np.intp], Effect]:
        """Return the whole samples of the delay, and the fraction that is left."""
        late, _ = super().late(robot)
        late[self.index], rest = whole_samples(self['delay_s'], robot.sample_time)
        return late, AngleDelay(self.site, (rest,))

    def on_state_space(self, plant: StateSpace, robot: Robot) -> StateSpace:
        """Return the plant with three states more; the joint's sensor reads the first of them."""
        return with_delayed_outputs(plant, np.array([self.index]), self['delay_s'])
