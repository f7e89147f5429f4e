"""Actuator gain: a drive responds to a command more or less strongly than it should."""

from __future__ import annotations

from typing import Any

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Effect, one_hot
from flex_plant_sim.effects.parameter import Parameter


class ActuatorGain(Effect):
    """A factor on the command of one drive."""

    identifier = 'actuator_gain'
    family = 'drive and timing'
    explanation = 'The drive of {site} makes more or less of a command than its data sheet says.'
    parameters = (
        Parameter('factor', '', 1.0, 0.2, 3.0, (0.5, 0.75, 0.9, 1.1, 1.3, 1.8), 0.03, 0.15),)
    sites = 'joint'

    def on_command(self, command: Array, history: Array, time: Any,
                   sample_time: float) -> Array:
        """Return the command times the factor."""
        return command * (1.0 + (self['factor'] - 1.0) * one_hot(self.index, 2))
