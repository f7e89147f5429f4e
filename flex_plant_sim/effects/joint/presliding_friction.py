"""Presliding friction: dry friction that builds up over a little travel, like a spring."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Motion, one_hot
from flex_plant_sim.effects.joint.bristles import Bristles
from flex_plant_sim.effects.parameter import Parameter
import numpy as np


class PreslidingFriction(Bristles):
    """Dry friction of one level in both directions and at any speed, of bristles that yield."""

    identifier = 'presliding_friction'
    explanation = 'Dry friction in {site} gives way a little, like a spring, before it slides.'
    parameters = (
        Parameter('level_n_m', 'N m', 0.0, 0.0, 20.0, (0.1, 0.4, 1.5), 0.05, 0.4),
        # Rolling bearings and seals slip after some mrad; a joint's sensor resolves 0.1 mrad.
        Parameter('travel_rad', 'rad', 0.002, 1e-5, 0.2, (0.001, 0.005, 0.02), np.inf, 0.01))

    @property
    def breakaway(self) -> float:
        """Return the level, N m."""
        return float(self['level_n_m'])

    def dry_friction(self, motion: Motion) -> tuple[Array, Array]:
        """Return the level in both directions, N m."""
        level = self['level_n_m'] * one_hot(self.index, 2)
        return level, level
