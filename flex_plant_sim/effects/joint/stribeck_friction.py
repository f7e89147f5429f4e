"""Stribeck friction: dry friction that falls as the speed of a joint rises from zero."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Motion, one_hot
from flex_plant_sim.effects.joint.bristles import Bristles, TRAVEL
from flex_plant_sim.effects.parameter import Parameter
import numpy as np


class StribeckFriction(Bristles):
    """
    Dry friction of one joint, level + extra exp(-(v / speed)^2).

    Armstrong-Hélouvry, Dupont and Canudas de Wit, Automatica 30 (1994), (3); v is the speed at
    the start of a step.
    """

    identifier = 'stribeck_friction'
    explanation = 'Dry friction in {site} is higher at rest and falls as the joint gets going.'
    parameters = (
        Parameter('level_n_m', 'N m', 0.0, 0.0, 20.0, (0.2, 0.8), 0.05, 1.0),
        Parameter('extra_n_m', 'N m', 0.0, 0.0, 20.0, (0.3, 1.0), 0.05, 1.0),
        Parameter('speed_rad_per_s', 'rad/s', 0.1, 0.01, 2.0, (0.05, 0.2), np.inf, 0.1),
        TRAVEL)

    @property
    def breakaway(self) -> float:
        """Return the friction at rest, N m."""
        return float(self['level_n_m'] + self['extra_n_m'])

    def dry_friction(self, motion: Motion) -> tuple[Array, Array]:
        """Return the level in both directions at the present speed, N m."""
        share = np.exp(-(motion.velocity[..., :2] / self['speed_rad_per_s'])**2)
        level = (self['level_n_m'] + self['extra_n_m'] * share) * one_hot(self.index, 2)
        return level, level
