"""Payload offset: the payload's centre is beyond the tip, or inboard of it."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.parameter import Parameter


class PayloadOffset(Effect):
    """Distance of the payload's centre beyond the tip along the link, added to the file's."""

    identifier = 'payload_offset'
    family = 'payload'
    explanation = 'The payload is not held at the tip, but farther out or farther in.'
    parameters = (
        # A gripper holds what it holds some centimetres beyond its flange.
        Parameter('offset_m', 'm', 0.0, -1.0, 1.0, (-0.3, -0.1, -0.03, 0.03, 0.1, 0.3),
                  0.005, 0.05),)
    sites = 'arm'
    structural = True

    def on_robot(self, robot: Robot) -> Robot:
        """Return the robot with the payload's centre moved."""
        return replace(robot, payload_offset=robot.payload_offset + self['offset_m'])
