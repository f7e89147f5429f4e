"""Presliding friction: dry friction that builds up over a little travel, like a spring."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array, SecondOrderForm
from flex_plant_sim.effects.base import Effect, FRICTION, Motion, one_hot, Parameter
from flex_plant_sim.effects.mechanics.kinematics import decided_by_step
import numpy as np

# N m; nothing is divided by zero.
LEAST_LEVEL = 1e-9


class PreslidingFriction(Effect):
    """
    A Maxwell-slip element: bristles of stiffness level/travel that slip at the level.

    Al-Bender, Lampaert and Swevers, IEEE TAC 50 (2005), one element. The bend z is a coordinate
    that the step decides, implicitly: the torque that the bristles have at the end of the step,
    (z + T v) / (travel/level + T reach), limited to the level. So it is stable at any T however
    stiff the bristles are, and dry friction in the limit of no travel.
    """

    identifier = 'presliding_friction'
    family = 'joint and gear'
    explanation = 'Dry friction in {site} gives way a little, like a spring, before it slides.'
    parameters = (
        Parameter('level_n_m', 'N m', 0.0, 0.0, 20.0, (0.1, 0.4, 1.5), 0.05, 0.4),
        # Rolling bearings and seals slip after some mrad; a joint's sensor resolves 0.1 mrad.
        Parameter('travel_rad', 'rad', 0.002, 1e-5, 0.2, (0.001, 0.005, 0.02), np.inf, 0.01))
    sites = 'joint'
    structural = True
    contact = FRICTION

    @property
    def bend(self) -> str:
        """Return the name of the coordinate that holds the bristles' bend, rad."""
        return f'bend_{self.site}'

    def on_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form with the bend as a coordinate that only the step moves."""
        return form if self.bend in form.names else decided_by_step(form, self.bend)

    def dry_friction(self, motion: Motion) -> tuple[Array, Array]:
        """Return the level both ways, N m."""
        level = self['level_n_m'] * one_hot(self.index, 2)
        return level, level

    def yielding(self) -> Array:
        """Return how far each joint's friction gives under a torque, rad/(N m), (2,)."""
        level = np.maximum(self['level_n_m'], LEAST_LEVEL)
        return np.asarray(self['travel_rad'] / level * one_hot(self.index, 2), dtype=float)
