"""Payload change: the arm picks up, drops or gradually loses its payload."""

from __future__ import annotations

from flex_plant_sim.effects.base import Effect, Parameter
import numpy as np


class PayloadChange(Effect):
    """The payload changes by a mass from a time on, at once or over a duration."""

    identifier = 'payload_change'
    family = 'payload'
    explanation = 'The payload changes during the record.'
    parameters = (
        Parameter('change_kg', 'kg', 0.0, -1.0, 2.0, (-0.08, 0.08), 0.005),
        Parameter('time_s', 's', 0.0, 0.0, 1e6, tuple(float(t) for t in range(2, 60, 2)), np.inf),
        Parameter('duration_s', 's', 0.0, 0.0, 1e6, (0.0, 3.0), np.inf))
    sites = 'arm'
    structural = True

    def payload_at(self, time: float, payload: float) -> float:
        """Return the payload, kg, at a time, s; at the instant of a step, that after it."""
        late = time - self['time_s']
        if late < 0.0:
            return payload
        share = min(late / self['duration_s'], 1.0) if self['duration_s'] > 0.0 else 1.0
        return max(payload + share * self['change_kg'], 0.0)
