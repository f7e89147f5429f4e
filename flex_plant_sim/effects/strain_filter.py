"""Strain filter: the strain amplifiers pass only slow signals."""

from __future__ import annotations

from flex_plant_sim.effects.base import Effect, Parameter
from flex_plant_sim.effects.extra_states import with_states
from flex_plant_sim.robot import Robot
from flex_plant_sim.state_space import StateSpace
import numpy as np

NO_FILTER = 1000.0


class StrainFilter(Effect):
    """omega^2 / (s^2 + 2 zeta omega s + omega^2) on every gauge."""

    identifier = 'strain_filter'
    family = 'sensors'
    explanation = 'The strain amplifiers pass only slow signals: a low-pass filter of order two.'
    parameters = (
        # Below 300 rad/s it delays by more than half a reference sample.
        Parameter('cutoff_rad_per_s', 'rad/s', NO_FILTER, 1.0, NO_FILTER,
                  (15.0, 30.0, 60.0, 120.0), NO_FILTER - 300.0),
        Parameter('damping', '', 0.8, 0.1, 3.0, (0.7,), np.inf))
    sites = 'arm'
    structural = True

    def on_state_space(self, plant: StateSpace, robot: Robot) -> StateSpace:
        """Return the plant with (w, w'/omega) of each gauge as its last states."""
        omega = self['cutoff_rad_per_s']
        if omega >= NO_FILTER:
            return plant
        old, gauges = plant.a.shape[-1], plant.c.shape[-2] - 2
        wider, unit = with_states(plant, 2 * gauges), np.eye(gauges)
        slow, fast = slice(old, old + gauges), slice(old + gauges, old + 2 * gauges)
        wider.a[..., slow, fast] = omega * unit
        wider.a[..., fast, slow] = -omega * unit
        wider.a[..., fast, fast] = -2.0 * self['damping'] * omega * unit
        wider.a[..., fast, :old] = omega * plant.c[..., 2:, :]
        wider.c[..., 2:, :] = 0.0
        wider.c[..., 2:, slow] = unit
        return wider
