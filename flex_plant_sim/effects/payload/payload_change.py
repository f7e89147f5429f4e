"""Payload change: the arm picks up, drops or gradually loses its payload."""

from __future__ import annotations

from typing import Any

from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.parameter import Parameter
import numpy as np


class PayloadChange(Effect):
    """The payload changes by a mass from a time on, either at once or along a ramp (a leak)."""

    identifier = 'payload_change'
    family = 'payload'
    explanation = 'The payload changes during the record.'
    parameters = (
        Parameter('change_kg', 'kg', 0.0, -1.0, 2.0, (-0.16, -0.08, 0.08, 0.16),
                  0.005, 0.08),
        Parameter('time_s', 's', 0.0, 0.0, 1e6, tuple(float(t) for t in range(2, 60, 2)),
                  np.inf, np.inf),
        Parameter('duration_s', 's', 0.0, 0.0, 1e6, (0.0, 3.0, 12.0), np.inf, 2.0,
                  optional=True))
    sites = 'arm'
    event_time = 'time_s'
    event_duration = 'duration_s'
    structural = True

    def payload_at(self, time: Any, payload: Any) -> Any:
        """Return the payload, kg, at times, s; at the time of a step, that after the step."""
        late = np.asarray(time) - self['time_s']
        share = late / self['duration_s'] if self['duration_s'] > 0.0 else late >= 0.0
        return np.maximum(payload + np.clip(share, 0.0, 1.0) * self['change_kg'], 0.0)
