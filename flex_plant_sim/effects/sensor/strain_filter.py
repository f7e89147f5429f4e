"""Strain filter: the strain amplifiers pass only slow signals."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.state_space import StateSpace
from flex_plant_sim.effects.base import Effect, Parameter
from flex_plant_sim.effects.mechanics.extra_states import with_states
import numpy as np

NO_FILTER = 1e-4


class StrainFilter(Effect):
    """1 / (1 + 2 zeta tau s + tau^2 s^2) on every gauge; the cut-off is 1/tau, rad/s."""

    identifier = 'strain_filter'
    family = 'sensors'
    explanation = 'The strain amplifiers pass only slow signals: a low-pass filter of order two.'
    parameters = (
        # It delays slow signals by 2 zeta tau: 0.003 s is half a reference sample.
        Parameter('time_constant_s', 's', 0.0, 0.0, 1.0, (0.008, 0.016, 0.03, 0.06), 0.003, 0.03),
        Parameter('damping', '', 0.8, 0.4, 3.0, (0.7,), np.inf, 0.3))
    sites = 'arm'
    structural = True

    def on_state_space(self, plant: StateSpace, robot: Robot) -> StateSpace:
        """Return the plant with (w, tau w') of each gauge as its last states."""
        if self['time_constant_s'] < NO_FILTER:
            return plant
        omega = 1.0 / self['time_constant_s']
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
