"""Modal damping: a link's vibration dies out faster or slower than assumed."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.parameter import Parameter


class ModalDamping(Effect):
    """A factor on one link's material damping."""

    identifier = 'modal_damping'
    family = 'links and structure'
    explanation = 'The vibration of {site} dies out faster or slower than its damping says.'
    parameters = (
        Parameter('factor', '', 1.0, 0.05, 100.0, (0.4, 2.5, 6.0, 15.0, 40.0), 0.6, 4.0),)
    sites = 'link'
    structural = True

    def on_robot(self, robot: Robot) -> Robot:
        """Return the robot with the link's damping ratio changed."""
        ratio = robot.links[self.index].damping_ratio * self['factor']
        return robot.with_link(self.index, damping_ratio=ratio)
