"""Strain delay: the strain readings are older than the angles logged with them."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.state_space import StateSpace
from flex_plant_sim.effects.base import Effect, Parameter
from flex_plant_sim.effects.mechanics.delay import with_delayed_outputs
from flex_plant_sim.effects.mechanics.gauge import gauge_places

# A delay closer than this to the next whole number of samples counts as whole, in samples.
WHOLE = 1e-6


class StrainDelay(Effect):
    """A delay of a site's gauges; whole samples can be split off one that all gauges share."""

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
        rows = 2 + gauge_places(robot, self.site)
        return with_delayed_outputs(plant, rows, self['delay_s'])
