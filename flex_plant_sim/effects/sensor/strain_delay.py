"""Strain delay: the strain readings are older than the angles logged with them."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.state_space import StateSpace
from flex_plant_sim.effects.base import Effect, Parameter
from flex_plant_sim.effects.mechanics.extra_states import with_states
from flex_plant_sim.effects.mechanics.gauge import gauge_places
import numpy as np

# Delay, s, below which there is none: a hundredth of a sample at 1 kHz.
NO_DELAY = 1e-5
# A delay closer than this to the next whole number of samples counts as whole, in samples.
WHOLE = 1e-6


class StrainDelay(Effect):
    """
    The Padé approximant (2, 3) of a delay on a site's gauges.

    exp(-s) = (60 - 24 s + 3 s^2) / (60 + 36 s + 9 s^2 + s^3) with s tau for s. Like a delay, and
    unlike the approximant (2, 2), it has no direct response. Its phase is correct to 1 % up to
    omega tau = 2. Whole samples can be split off a delay that all gauges share.
    """

    identifier = 'strain_delay'
    family = 'sensors'
    explanation = 'The strain readings of {site} are older than the angles logged with them.'
    parameters = (
        Parameter('delay_s', 's', 0.0, 0.0, 0.2, (0.005, 0.01, 0.02, 0.03, 0.05), 0.003, 0.03),)
    sites = 'amplifier'
    structural = True

    def late(self, sample_time: float) -> tuple[int, Effect]:
        """Return the whole samples of the delay, and the fraction that is left."""
        if self.site != 'arm':
            return 0, self
        whole = int(self['delay_s'] / sample_time + WHOLE)
        return whole, StrainDelay(self.site, (max(self['delay_s'] - whole * sample_time, 0.0),))

    def on_state_space(self, plant: StateSpace, robot: Robot) -> StateSpace:
        """Return the plant with three states per gauge; the gauge reads the first of them."""
        delay = self['delay_s']
        if delay < NO_DELAY:
            return plant
        rows = 2 + gauge_places(robot, self.site)
        old, count = plant.a.shape[-1], len(rows)
        wider, unit = with_states(plant, 3 * count), np.eye(count)
        first, second, third = (slice(old + k * count, old + (k + 1) * count) for k in range(3))
        wider.a[..., first, second] = wider.a[..., second, third] = unit / delay
        for row, back, ahead in ((first, 9.0, 3.0), (second, 36.0, -24.0), (third, 60.0, 60.0)):
            wider.a[..., row, first] = -back / delay * unit
            wider.a[..., row, :old] = ahead / delay * plant.c[..., rows, :]
        wider.c[..., rows, :] = 0.0
        wider.c[..., rows, first] = unit
        return wider
