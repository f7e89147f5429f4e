"""Dead zone: a drive ignores small commands."""

from __future__ import annotations

from typing import Any

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Effect, one_hot
from flex_plant_sim.effects.parameter import Parameter
import numpy as np


class ActuatorDeadZone(Effect):
    """One drive receives sign(u) max(|u| - half width, 0) instead of its command u."""

    identifier = 'actuator_dead_zone'
    family = 'drive and timing'
    explanation = 'The drive of {site} ignores small commands and shortens the others by as much.'
    parameters = (
        Parameter('half_width', 'command unit', 0.0, 0.0, 1.0, (0.02, 0.06, 0.2), 0.005, 0.1),)
    sites = 'joint'

    def on_command(self, command: Array, history: Array, time: Any,
                   sample_time: float) -> Array:
        """Return the command less the half width, zero inside it."""
        half = self['half_width'] * one_hot(self.index, 2)
        return command - np.clip(command, -half, half)
