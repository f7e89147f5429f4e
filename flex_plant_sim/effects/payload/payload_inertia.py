"""Payload inertia: the payload is bulky rather than a point."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.parameter import Parameter


class PayloadInertia(Effect):
    """Moment of inertia about the tip, added to that of the robot file."""

    identifier = 'payload_inertia'
    family = 'payload'
    explanation = 'The payload is bulky: it resists turning, not only moving.'
    parameters = (
        # 2e-4 kg m^2 is 0.1 kg at a radius of gyration of 45 mm.
        Parameter('inertia_kg_m2', 'kg m^2', 0.0, 0.0, 0.2,
                  (5e-4, 2e-3, 6e-3, 2e-2), 2e-4, 0.003),)
    sites = 'arm'
    structural = True

    def on_robot(self, robot: Robot) -> Robot:
        """Return the robot with the payload's inertia raised."""
        return replace(robot, payload_inertia=robot.payload_inertia + self['inertia_kg_m2'])
