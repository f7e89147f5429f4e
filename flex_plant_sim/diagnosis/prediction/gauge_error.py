"""What gauges see and the modes leave out: a small error of each gauge that comes and goes."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.arm.state_space import StateSpace
from flex_plant_sim.diagnosis.record.allowance import model_error
from flex_plant_sim.diagnosis.record.windows import Windows
from flex_plant_sim.effects.base import Effect, Parameter
from flex_plant_sim.effects.mechanics.extra_states import with_states
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

PERIODS = 0.05


class GaugeError(Effect):
    """
    An error of every strain before its sensor: white noise through a low-pass of order one.

    Its size is the model error that is allowed for. Without it a hypothesis that only loosens
    the gauges from the arm would be credited with what no model of few modes predicts.
    """

    identifier = 'gauge_error'
    family = 'part of the predictor'
    explanation = 'Of the strain, the modes of the model leave out a small part.'
    parameters = (Parameter('time_constant_s', 's', 0.0, 1e-6, 1e3, (1.0,), np.inf, 1.0),)
    sites = 'arm'

    @classmethod
    def of(cls, windows: Windows, sample_time: float) -> GaugeError:
        """Return the error that lasts a twentieth of the slowest mode's period."""
        return cls('arm', (PERIODS * windows.warm_up * sample_time,))

    def on_state_space(self, plant: StateSpace, robot: Robot) -> StateSpace:
        """Return the plant with one state a gauge, which adds to what the gauge sees."""
        old, gauges = plant.a.shape[-1], plant.c.shape[-2] - 2
        wider = with_states(plant, gauges)
        wider.a[..., old:, old:] = -np.eye(gauges) / self['time_constant_s']
        wider.c[..., 2:, old:] = np.eye(gauges)
        return wider

    def step_variance(self, arm: ExtendedArm, windows: Windows) -> Array:
        """Return what a step's noise adds to the variance of an arm's states, (n,)."""
        variance, first = np.zeros(arm.states), arm.own_states
        error = model_error([windows.record])[2:]
        decay = np.exp(-2.0 * arm.step_time / self['time_constant_s'])
        variance[first:first + error.size] = error * (1.0 - decay)
        return variance
