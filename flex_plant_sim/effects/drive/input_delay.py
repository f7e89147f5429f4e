"""Input delay: commands reach the drives late."""

from __future__ import annotations

import math
from typing import Any

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.parameter import Parameter
import numpy as np


class InputDelay(Effect):
    """
    The commands of one drive or of both are late by a time that may be a fraction of a sample.

    The command of a step is the mean of those that reach the drive within it: for a delay of
    k + f samples, (1 - f) u_k + f u_(k+1) of the commands k and k + 1 samples ago.
    """

    identifier = 'input_delay'
    family = 'drive and timing'
    explanation = 'Commands to {site} arrive late.'
    parameters = (
        # A fifth of the reference sample time.
        Parameter('delay_s', 's', 0.0, 0.0, 0.2, (0.005, 0.01, 0.02, 0.03, 0.05), 0.002, 0.03),)
    sites = 'drive'

    def memory(self, sample_time: float) -> int:
        """Return the delay in samples, rounded up."""
        return math.ceil(float(np.max(self['delay_s'])) / sample_time - 1e-9)

    def on_command(self, command: Array, history: Array, time: Any,
                   sample_time: float) -> Array:
        """Return the command of delay_s ago, interpolated between samples."""
        known = history.shape[-2]
        age = known - np.arange(known + 1.0)
        weight = np.maximum(1.0 - np.abs(age - np.asarray(self['delay_s']) / sample_time), 0.0)
        late = (weight[..., None, :known] @ history)[..., 0, :] + weight[..., known:] * command
        if self.site == 'arm':
            return late
        return np.where(np.arange(2) == self.index, late, command)
