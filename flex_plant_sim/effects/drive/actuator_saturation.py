"""Saturation: a drive limits commands to less than it should."""

from __future__ import annotations

from typing import Any

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.parameter import Parameter
import numpy as np

# Inverse limit, 1/command unit, below which there is none: no robot file has a command_limit
# beyond 1e6.
NO_LIMIT = 1e-9


class ActuatorSaturation(Effect):
    """
    The command of one drive is limited; the log holds the command before that.

    The parameter is one over the limit, so that zero means no limit.
    """

    identifier = 'actuator_saturation'
    family = 'drive and timing'
    explanation = 'The drive of {site} cannot follow large commands: it saturates.'
    parameters = (
        # Relevant below 2 command units, which ordinary moves of the known robots reach.
        Parameter('inverse_limit', '1/command unit', 0.0, 0.0, 100.0,
                  (1.0, 1.7, 2.8, 5.0), 0.5, 3.0),)
    sites = 'joint'

    def on_command(self, command: Array, history: Array, time: Any,
                   sample_time: float) -> Array:
        """Return the command with one joint's limited."""
        limit = 1.0 / np.maximum(self['inverse_limit'], NO_LIMIT)
        limited = np.clip(command, -limit, limit)
        return np.where(np.arange(2) == self.index, limited, command)
