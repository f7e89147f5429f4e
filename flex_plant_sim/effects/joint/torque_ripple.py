"""Torque ripple: a torque that repeats with the joint angle (cogging, gear teeth)."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Effect, Motion
from flex_plant_sim.effects.parameter import Parameter
import numpy as np


class TorqueRipple(Effect):
    """The torque sine sin(k theta) + cosine cos(k theta) on one joint, k periods per turn."""

    identifier = 'torque_ripple'
    family = 'joint and gear'
    explanation = 'The torque of {site} ripples with its angle, as gear teeth or poles pass.'
    parameters = (
        Parameter('sine_n_m', 'N m', 0.0, -20.0, 20.0, (-0.5, 0.5), 0.1, 1.0),
        Parameter('cosine_n_m', 'N m', 0.0, -20.0, 20.0, (-0.5, 0.5), 0.1, 1.0),
        # Fewer are a smooth law of the angle, as of a cable: even a two-pole motor cogs six times.
        Parameter('periods_per_turn', '', 10.0, 4.0, 200.0,
                  tuple(float(k) for k in range(4, 45)), np.inf, 15.0))
    sites = 'joint'
    linear = True

    def force(self, motion: Motion) -> Array:
        """Return the torque as a generalised force, (…, N)."""
        phase = self['periods_per_turn'] * motion.position[..., self.index:self.index + 1]
        torque = self['sine_n_m'] * np.sin(phase) + self['cosine_n_m'] * np.cos(phase)
        return torque * motion.form.force[:, self.index]
