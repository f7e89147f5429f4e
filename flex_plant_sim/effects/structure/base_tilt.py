"""Base tilt: the plane of motion is not level, so gravity acts in it."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.arm.units import GRAVITY
from flex_plant_sim.effects.base import Effect, Motion
from flex_plant_sim.effects.mechanics.kinematics import elbow_state, field_load
from flex_plant_sim.effects.parameter import Parameter
import numpy as np


class BaseTilt(Effect):
    """
    Gravity g (sin tilt_x, sin tilt_y) in the plane of motion.

    x points along the stretched arm at zero angles, y to its left. With a positive tilt that side
    is lower.
    """

    identifier = 'base_tilt'
    family = 'links and structure'
    explanation = 'The base is not level: gravity pulls the arm to one side.'
    parameters = (
        Parameter('tilt_x_rad', 'rad', 0.0, -0.5, 0.5, (-0.1, -0.03, 0.03, 0.1), 0.003, 0.04),
        Parameter('tilt_y_rad', 'rad', 0.0, -0.5, 0.5, (-0.1, -0.03, 0.03, 0.1), 0.003, 0.04))
    sites = 'arm'

    def force(self, motion: Motion) -> Array:
        """Return gravity's generalised force, (…, N)."""
        form, position = motion.form, motion.position
        first = position[..., :1]
        second = first + (position @ form.elbow_angle)[..., None]
        x, y = (GRAVITY * np.sin(self[name]) for name in ('tilt_x_rad', 'tilt_y_rad'))
        cosine, _ = elbow_state(form, position)
        return field_load(form, motion.robot, motion.payload,
                          y * np.cos(first) - x * np.sin(first),
                          y * np.cos(second) - x * np.sin(second), cosine)
