"""Saturation: a drive cuts commands off earlier than it should."""

from __future__ import annotations

from typing import Any

from flex_plant_sim.arm_model import Array
from flex_plant_sim.effects.base import Effect, Parameter
import numpy as np

NEVER_REACHED = 100.0


class ActuatorSaturation(Effect):
    """One drive's command is limited; the log holds what was asked for."""

    identifier = 'actuator_saturation'
    family = 'drive and timing'
    explanation = 'The drive of {site} cannot follow large commands: it saturates.'
    parameters = (
        # Relevant below 2 command units, which ordinary moves of the known robots reach.
        Parameter('limit', 'command unit', NEVER_REACHED, 0.01, NEVER_REACHED,
                  (0.2, 0.35, 0.6, 1.0), NEVER_REACHED - 2.0),)
    sites = 'joint'

    def on_command(self, command: Array, history: Array, time: Any,
                   sample_time: float) -> Array:
        """Return the command with one joint's limited."""
        limited = np.clip(command, -self['limit'], self['limit'])
        return np.where(np.arange(2) == self.index, limited, command)
