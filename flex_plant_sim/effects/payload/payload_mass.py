"""Payload mass: the arm carries more or less than it was told."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.parameter import Parameter


class PayloadMass(Effect):
    """A constant deviation of the payload from the mass that the arm was told."""

    identifier = 'payload_mass'
    family = 'payload'
    explanation = 'The payload is heavier or lighter than the arm was told.'
    parameters = (
        Parameter('deviation_kg', 'kg', 0.0, -1.0, 2.0,
                  (-0.1, -0.04, -0.015, 0.015, 0.04, 0.1), 0.005, 0.06),)
    sites = 'arm'
    structural = True

    def on_robot(self, robot: Robot) -> Robot:
        """Return the robot with the payload changed (it stays at least zero)."""
        return replace(robot, payload_mass=max(robot.payload_mass + self['deviation_kg'], 0.0))
