"""Presliding friction: dry friction that builds up over a little travel, like a spring."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array, SecondOrderForm
from flex_plant_sim.effects.base import Effect, FRICTION, Motion, one_hot, Parameter
from flex_plant_sim.effects.mechanics.kinematics import with_step_coordinate
import numpy as np

# Least level, N m, so that the stiffness of the bristles is never zero.
LEAST_LEVEL = 1e-9


class PreslidingFriction(Effect):
    """
    A Maxwell-slip element: bristles of stiffness level/travel that slip at the level.

    Al-Bender, Lampaert and Swevers, IEEE TAC 50 (2005), one element. The deflection z of the
    bristles is a coordinate that the step sets implicitly: their torque is that at the end of the
    step, (z + T v) / (travel/level + T reach), limited to the level. It is therefore stable at any
    T however stiff the bristles are, and becomes dry friction in the limit of no travel.
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
        """Return the name of the coordinate of the bristles' deflection, rad."""
        return f'bend_{self.site}'

    def on_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form with the deflection as a coordinate that only the step changes."""
        return form if self.bend in form.names else with_step_coordinate(form, self.bend)

    def dry_friction(self, motion: Motion) -> tuple[Array, Array]:
        """Return the level in both directions, N m."""
        level = self['level_n_m'] * one_hot(self.index, 2)
        return level, level

    def yielding(self) -> Array:
        """Return the presliding compliance of each joint's friction, rad/(N m), (2,)."""
        level = np.maximum(self['level_n_m'], LEAST_LEVEL)
        return np.asarray(self['travel_rad'] / level * one_hot(self.index, 2), dtype=float)
