"""Link stiffness: a link bends more or less than its data sheet says."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.parameter import Parameter


class LinkStiffness(Effect):
    """A factor on one link's Young's modulus."""

    identifier = 'link_stiffness'
    family = 'links and structure'
    explanation = 'The bending stiffness of {site} differs from its data sheet.'
    parameters = (Parameter('factor', '', 1.0, 0.1, 5.0,
                            (0.5, 0.75, 0.88, 1.12, 1.3, 1.8), 0.06, 0.25),)
    sites = 'link'
    structural = True

    def on_robot(self, robot: Robot) -> Robot:
        """Return the robot with the link's modulus changed."""
        modulus = robot.links[self.index].youngs_modulus * self['factor']
        return robot.with_link(self.index, youngs_modulus=modulus)
