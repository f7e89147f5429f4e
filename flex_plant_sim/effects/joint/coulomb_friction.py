"""Coulomb friction: a joint's torque against motion that does not depend on speed."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Effect, FRICTION, Motion, one_hot
from flex_plant_sim.effects.parameter import Parameter


class CoulombFriction(Effect):
    """Dry friction of one joint, with the same level in both directions."""

    identifier = 'coulomb_friction'
    family = 'joint and gear'
    explanation = 'Dry friction in {site} takes the same torque at any speed.'
    parameters = (
        # The reference elbow's drive damps with 5 N m at 1 rad/s: 0.05 N m is 2 % of it at 0.5.
        Parameter('level_n_m', 'N m', 0.0, 0.0, 20.0, (0.1, 0.4, 1.5), 0.05, 1.0),)
    sites = 'joint'
    contact = FRICTION

    def dry_friction(self, motion: Motion) -> tuple[Array, Array]:
        """Return the level in both directions, N m."""
        level = self['level_n_m'] * one_hot(self.index, 2)
        return level, level
