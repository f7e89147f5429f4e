"""Joint spring: a cable or a hose pulls the joint to the angle at which it is slack."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Effect, Motion
from flex_plant_sim.effects.parameter import Parameter
import numpy as np


class JointSpring(Effect):
    """The torque -k (theta - rest) on one joint."""

    identifier = 'joint_spring'
    family = 'joint and gear'
    explanation = 'A spring, such as a cable or a hose, pulls {site} to one angle.'
    parameters = (
        # At an angle of 1 rad as conceivable as a friction of 1 N m.
        Parameter('stiffness_n_m_per_rad', 'N m/rad', 0.0, 0.0, 50.0, (0.2, 1.0, 4.0), 0.05, 1.0),
        # Quantiles of the prior: where the joint works around another angle, a spring that rests
        # at zero looks like no spring.
        Parameter('rest_rad', 'rad', 0.0, -6.3, 6.3, (-1.0, -0.4, -0.15, 0.0, 0.15, 0.4, 1.0),
                  np.inf, 0.5))
    sites = 'joint'
    linear = True

    def force(self, motion: Motion) -> Array:
        """Return the torque as a generalised force, (…, N)."""
        angle = motion.position[..., self.index:self.index + 1]
        torque = -self['stiffness_n_m_per_rad'] * (angle - self['rest_rad'])
        return torque * motion.form.force[:, self.index]
