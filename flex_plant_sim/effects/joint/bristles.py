"""Bristles: dry friction that builds up over a little travel, like a spring, before it slides."""

from __future__ import annotations

from abc import abstractmethod

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array, SecondOrderForm
from flex_plant_sim.effects.base import Effect, FRICTION, one_hot
from flex_plant_sim.effects.mechanics.kinematics import with_step_coordinate
from flex_plant_sim.effects.parameter import Parameter
import numpy as np

# Least friction, N m, so that the stiffness of the bristles is never zero.
LEAST_LEVEL = 1e-9
# Rolling bearings and seals slip after some mrad; a joint's sensor resolves 0.1 mrad, so that less
# is none.
TRAVEL = Parameter('travel_rad', 'rad', 0.0, 0.0, 0.2, (1e-4, 1e-3, 5e-3), np.inf, 0.01,
                   optional=True, switched=True)


class Bristles(Effect):
    """
    A Maxwell-slip element: bristles of stiffness breakaway/travel that slip at a level.

    Al-Bender, Lampaert and Swevers, IEEE TAC 50 (2005), one element. The deflection z of the
    bristles is a coordinate that the step sets implicitly: their torque is that at the end of the
    step, (z + T v) / (travel/breakaway + T reach), limited to the level. It is therefore stable at
    any T however stiff the bristles are, and becomes dry friction in the limit of no travel.
    """

    family = 'joint and gear'
    sites = 'joint'
    structural = True
    contact = FRICTION

    @property
    @abstractmethod
    def breakaway(self) -> float:
        """Return the friction after the travel, N m."""

    @property
    def bend(self) -> str:
        """Return the name of the coordinate of the bristles' deflection, rad."""
        return f'bend_{self.site}'

    def on_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form with the deflection as a coordinate that only the step changes."""
        yields = self['travel_rad'] > 0.0 and self.bend not in form.names
        return with_step_coordinate(form, self.bend) if yields else form

    def yielding(self) -> Array:
        """Return the presliding compliance of each joint's friction, rad/(N m), (2,)."""
        compliance = self['travel_rad'] / max(self.breakaway, LEAST_LEVEL)
        return np.asarray(compliance * one_hot(self.index, 2), dtype=float)
