"""Asymmetric friction: dry friction that differs between the two directions."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Motion, one_hot
from flex_plant_sim.effects.joint.bristles import Bristles, TRAVEL
from flex_plant_sim.effects.parameter import Parameter


class AsymmetricFriction(Bristles):
    """Dry friction of one joint with its own level in each direction."""

    identifier = 'asymmetric_friction'
    explanation = 'Dry friction in {site} is stronger one way than the other.'
    parameters = (
        Parameter('forward_n_m', 'N m', 0.0, 0.0, 20.0, (0.1, 0.6), 0.05, 1.0),
        Parameter('backward_n_m', 'N m', 0.0, 0.0, 20.0, (0.6, 0.1), 0.05, 1.0), TRAVEL)

    @property
    def breakaway(self) -> float:
        """Return the mean of the two levels, N m."""
        return 0.5 * float(self['forward_n_m'] + self['backward_n_m'])

    def dry_friction(self, motion: Motion) -> tuple[Array, Array]:
        """Return the levels against positive and against negative velocity, N m."""
        joint = one_hot(self.index, 2)
        return self['forward_n_m'] * joint, self['backward_n_m'] * joint
