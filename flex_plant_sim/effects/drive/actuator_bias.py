"""Actuator bias: a drive acts as if a constant were added to its command."""

from __future__ import annotations

from typing import Any

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Effect, one_hot
from flex_plant_sim.effects.parameter import Parameter


class ActuatorBias(Effect):
    """A constant added to the command of one drive, in the drive's own unit."""

    identifier = 'actuator_bias'
    family = 'drive and timing'
    explanation = 'The drive of {site} pushes a little all the time, even at zero command.'
    parameters = (
        # 0.005 rad/s on the reference robot: 0.2 rad of drift in 40 s.
        Parameter('bias', 'command unit', 0.0, -1.0, 1.0, (-0.03, 0.03), 0.005, 0.04),)
    sites = 'joint'
    linear = True

    def on_command(self, command: Array, history: Array, time: Any,
                   sample_time: float) -> Array:
        """Return the command plus the constant."""
        return command + self['bias'] * one_hot(self.index, 2)
