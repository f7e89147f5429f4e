"""Viscous friction: more damping in a joint than its drive is known to have."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.parameter import Parameter

# Least share of a drive's damping that a negative value leaves, because the reduced model divides
# by the damping: a five-hundredth of the tolerance to which it is known.
LEAST_DAMPING_SHARE = 1e-4


class ViscousFriction(Effect):
    """Damping added to one drive; negative if the data sheet gives too much."""

    identifier = 'viscous_friction'
    family = 'joint and gear'
    explanation = 'Friction that grows with speed brakes {site} more than the drive is known to.'
    parameters = (
        # 4 % of the reference elbow's 5 N m s/rad; drives are known within about 5 %.
        Parameter('damping_n_m_s', 'N m s/rad', 0.0, -10.0, 50.0, (-1.0, -0.3, 0.5, 3.0, 12.0),
                  0.2, 3.0),)
    sites = 'joint'
    structural = True

    @classmethod
    def at(cls, site: str, robot: Robot) -> tuple[Parameter, ...]:
        """Return the parameter with bounds that leave the drive some damping."""
        damping, = super().at(site, robot)
        own = robot.drives[cls(site, (0.0,)).index].damping
        return (replace(damping, low=max(damping.low, (LEAST_DAMPING_SHARE - 1.0) * own)),)

    def on_robot(self, robot: Robot) -> Robot:
        """Return the robot with the drive's damping changed (it stays positive)."""
        drive = robot.drives[self.index]
        own = drive.damping
        damping = max(own + self['damping_n_m_s'], LEAST_DAMPING_SHARE * own)
        return robot.with_drive(self.index, damping=damping,
                                friction=drive.friction + damping - own)
