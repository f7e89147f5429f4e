"""Drive bandwidth: a velocity loop is slower or faster than its data sheet says."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.parameter import Parameter


class DriveBandwidth(Effect):
    """
    A factor on a velocity loop's time constant; its steady gain does not change.

    The loop's torque is J/tau (k u - theta'), so its torque gain and its damping are both divided
    by the factor. A current drive has no loop: `viscous_friction` changes its damping, and
    `actuator_gain` its torque gain.
    """

    identifier = 'drive_bandwidth'
    family = 'drive and timing'
    explanation = 'The velocity loop of {site} is slower or faster than its data sheet says.'
    parameters = (
        # Loops are tuned by hand: half or twice as fast is common. Drives are known within 5 %.
        Parameter('time_constant_factor', '', 1.0, 0.1, 20.0, (0.6, 1.6, 4.0), 0.1, 0.7),)
    sites = 'velocity_loop'
    structural = True

    def on_robot(self, robot: Robot) -> Robot:
        """Return the robot with the loop's torque gain and damping divided by the factor."""
        drive, factor = robot.drives[self.index], self['time_constant_factor']
        return robot.with_drive(self.index, torque_gain=drive.torque_gain / factor,
                                damping=drive.damping / factor)
