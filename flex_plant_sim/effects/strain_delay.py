"""Strain delay: the strain readings are older than the angles logged with them."""

from __future__ import annotations

from flex_plant_sim.effects.base import Effect, Parameter
from flex_plant_sim.effects.extra_states import with_states
from flex_plant_sim.robot import Robot
from flex_plant_sim.state_space import StateSpace
import numpy as np

NO_DELAY = 1e-5


class StrainDelay(Effect):
    """
    The Padé approximant (2, 2) of a delay on every gauge.

    exp(-s tau) = (1 - s tau/2 + (s tau)^2/12) / (1 + s tau/2 + (s tau)^2/12), all-pass; its
    phase is right to 1 % up to omega tau = 1.7 and to 6 % at 3.
    """

    identifier = 'strain_delay'
    family = 'sensors'
    explanation = 'The strain readings are older than the angles logged with them.'
    parameters = (
        Parameter('delay_s', 's', 0.0, 0.0, 0.2, (0.005, 0.01, 0.02, 0.03, 0.05), 0.003),)
    sites = 'arm'
    structural = True

    def on_state_space(self, plant: StateSpace, robot: Robot) -> StateSpace:
        """Return the plant with two states a gauge; a gauge then reads strain - z_2."""
        delay = self['delay_s']
        if delay < NO_DELAY:
            return plant
        old, gauges = plant.a.shape[-1], plant.c.shape[-2] - 2
        wider, unit = with_states(plant, 2 * gauges), np.eye(gauges)
        first, second = slice(old, old + gauges), slice(old + gauges, old + 2 * gauges)
        rate = np.sqrt(12.0) / delay
        wider.a[..., first, second], wider.a[..., second, first] = rate * unit, -rate * unit
        wider.a[..., second, second] = -6.0 / delay * unit
        wider.a[..., second, :old] = 12.0 / delay * plant.c[..., 2:, :]
        wider.c[..., 2:, second] = -unit
        return wider
