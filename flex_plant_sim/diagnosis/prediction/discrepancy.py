"""
Model discrepancy: what every model is allowed to miss, and what a hypothesis says beyond causes.

A slow torque of each joint and a slow error of each gauge are states of every filter that compares
hypotheses, see M. C. Kennedy and A. O'Hagan, Journal of the Royal Statistical Society B 63 (2001).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.arm.state_space import StateSpace
from flex_plant_sim.diagnosis.prediction.process_noise import net_torques
from flex_plant_sim.diagnosis.record.windows import Windows
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.mechanics.extra_states import with_states
from flex_plant_sim.effects.parameter import Parameter
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np


@dataclass(frozen=True)
class DiscrepancyModel:
    """
    The discrepancy that is allowed to every model, and what is unknown under one hypothesis.

    The nominal model has the defaults. Fits that differ in any of the last four attributes stand
    for different hypotheses with the same causes.

    Attributes
    ----------
    torque_share : tuple of float
        Standard deviation of each joint's torque, as a share of the drive's net one, see
        `net_torques`.
    gauge_share : float
        Standard deviation of a gauge's error, as a share of what it shows.
    torque_periods, gauge_periods : float
        Correlation times, in periods of the slowest mode.
    remainder : bool
        Whether something unknown besides explains errors of any size.
    far_part : str
        Name of a part that is not as its file says, see FAR_PART_FACTOR; empty if none.
    laws : tuple of Effect
        Torques known as tables over one variable.
    law_penalties : tuple of float
        Occam factor of each table, nats, see `Law.occam_penalty`.

    """

    # On clean arms of other simulators no channel errs by more than these state: joints by 0.94
    # of it, gauges by 0.21 to 0.48, with a gauge share of 1 % by 0.44 to 0.75
    # (benchmarks/discrepancy.py --runs 20).
    # With smaller values the parts absorb systematic errors: their posterior says most of the
    # true ones with 6 % (benchmarks/temper.py --torque 0.03, 0.06, 0.1).
    torque_share: tuple[float, float] = (0.06, 0.06)
    gauge_share: float = 0.05
    torque_periods: float = 1.0
    gauge_periods: float = 0.3
    remainder: bool = False
    far_part: str = ''
    laws: tuple[Effect, ...] = ()
    law_penalties: tuple[float, ...] = ()

    def without_law(self, law: Effect) -> DiscrepancyModel:
        """Return the same without a law; joints without a law have the default share."""
        kept = [k for k, other in enumerate(self.laws) if other != law]
        laws = tuple(self.laws[k] for k in kept)
        with_law = [any(other.index == joint for other in laws) for joint in range(2)]
        first, second = np.where(with_law, self.torque_share, DiscrepancyModel.torque_share)
        return replace(self, torque_share=(float(first), float(second)), laws=laws,
                       law_penalties=tuple(self.law_penalties[k] for k in kept))


class Discrepancy(Effect):
    """
    Ornstein-Uhlenbeck torques on both joints and errors of all gauges, as states of the filter.

    Inside the filter, because a cause that only makes the innovations whiter must not gain
    evidence by it. It is the same under every hypothesis.
    """

    identifier = 'discrepancy'
    family = 'part of the predictor'
    explanation = 'The model lacks a little, slowly changing.'
    parameters = (Parameter('torque_time_s', 's', 0.0, 1e-6, 1e3, (1.0,), np.inf, 1.0),
                  Parameter('gauge_time_s', 's', 0.0, 1e-6, 1e3, (1.0,), np.inf, 1.0))
    sites = 'arm'

    @classmethod
    def of(cls, discrepancy: DiscrepancyModel, period: float) -> Discrepancy:
        """Return the discrepancy of an arm whose slowest mode has a period, s."""
        return cls('arm', (discrepancy.torque_periods * period,
                           discrepancy.gauge_periods * period))

    def on_state_space(self, plant: StateSpace, robot: Robot) -> StateSpace:
        """Return the plant with two torques and an error of each gauge as its last states."""
        old, gauges = plant.a.shape[-1], plant.c.shape[-2] - 2
        wider = with_states(plant, 2 + gauges)
        torque, gauge = slice(old, old + 2), slice(old + 2, None)
        wider.a[..., :old, torque] = plant.e[..., :, :2]
        wider.a[..., torque, torque] = -np.eye(2) / self['torque_time_s']
        wider.a[..., gauge, gauge] = -np.eye(gauges) / self['gauge_time_s']
        wider.c[..., 2:, gauge] = np.eye(gauges)
        return wider

    def step_variance(self, arm: ExtendedArm, windows: Windows, discrepancy: DiscrepancyModel
                      ) -> Array:
        """Return the variance of the process noise that a step adds to an arm's states, (n,)."""
        variance, first = np.zeros(arm.states), arm.own_states
        sizes = np.concatenate([
            np.multiply(discrepancy.torque_share, net_torques(arm, windows)),
            discrepancy.gauge_share * windows.record.output_deviation[2:]])
        times = np.array([self['torque_time_s']] * 2 + [self['gauge_time_s']] * (sizes.size - 2))
        kept = np.exp(-2.0 * arm.step_time / times)
        variance[first:first + sizes.size] = sizes**2 * (1.0 - kept)
        return variance
