"""Strain filter: the strain amplifiers pass only slow signals."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.state_space import StateSpace
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.mechanics.extra_states import with_states
from flex_plant_sim.effects.mechanics.gauge import gauge_places
from flex_plant_sim.effects.parameter import Parameter
import numpy as np

# Time constant, s, below which there is no filter: a tenth of a sample at 1 kHz.
NO_FILTER = 1e-4


class StrainFilter(Effect):
    """Low pass 1 / (1 + 2 zeta tau s + tau^2 s^2) on a site's gauges; cut-off 1/tau, rad/s."""

    identifier = 'strain_filter'
    family = 'sensors'
    explanation = 'The strain of {site} passes a slow amplifier: a low-pass filter of order two.'
    parameters = (
        # It delays slow signals by 2 zeta tau: 0.003 s is half a reference sample.
        Parameter('time_constant_s', 's', 0.0, 0.0, 1.0, (0.008, 0.016, 0.03, 0.06, 0.12), 0.003,
                  0.03),
        Parameter('damping', '', 0.8, 0.4, 3.0, (0.7,), np.inf, 0.3))
    sites = 'amplifier'
    structural = True

    @property
    def remark(self) -> str:
        """Return by how much slow signals come late, 2 zeta tau: of one lag that is its tau."""
        late = 2e3 * self['damping'] * self['time_constant_s']
        return f'so that slow strains come {late:.3g} ms late'

    def on_state_space(self, plant: StateSpace, robot: Robot) -> StateSpace:
        """Return the plant with (w, tau w') of each gauge as its last states."""
        if self['time_constant_s'] < NO_FILTER:
            return plant
        omega = 1.0 / self['time_constant_s']
        rows = 2 + gauge_places(robot, self.site)
        old, count = plant.a.shape[-1], len(rows)
        wider, unit = with_states(plant, 2 * count), np.eye(count)
        slow, fast = slice(old, old + count), slice(old + count, old + 2 * count)
        wider.a[..., slow, fast] = omega * unit
        wider.a[..., fast, slow] = -omega * unit
        wider.a[..., fast, fast] = -2.0 * self['damping'] * omega * unit
        wider.a[..., fast, :old] = omega * plant.c[..., rows, :]
        wider.c[..., rows, :] = 0.0
        wider.c[..., rows, slow] = unit
        return wider
