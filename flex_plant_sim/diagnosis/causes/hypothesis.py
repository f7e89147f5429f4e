"""
Hypotheses: one effect of the catalogue at one site, with priors, bounds and starts; and sets.

The search makes one `Hypothesis` of each effect and site and fits `CauseSet`s of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import product
import math

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.likelihood.evidence import ParameterPrior
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.effects import catalogue, sites
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.parameter import Parameter
import numpy as np

# Step of finite differences, as a share of a parameter's deviation from null: small enough for
# linearity, large enough for rounding.
DIFFERENCE_SHARE = 0.05
# Starts from which on a shape parameter is searched on a grid: in the catalogue times, angles and
# numbers of periods have seven and more, other shapes four at most.
MIN_GRID_STARTS = 5
# Prior width of a fixed parameter, in its unit; small enough to stand for a point.
FIXED_WIDTH = 1e-9
# Standard deviation of the logarithm of a parameter's typical size: to a factor of two, as far as
# rules to scale it to another robot are apart (a torque on the Quanser's by 0.42 with inertias,
# by 0.21 and 0.32 with what the drives need at 1 rad/s and 1 rad/s^2).
WIDTH_SPREAD = math.log(2.0)
# Arms that are predicted at once; memory grows with them.
BATCH_SIZE = 8


@dataclass(frozen=True)
class Hypothesis:
    """
    An effect at a site, with its parameters as they can be on the robot.

    A parameter with few values (`Parameter.kinds`) is fixed: its bounds coincide, and each value
    is a hypothesis of its own with the same label.
    """

    effect: type[Effect]
    site: str
    parameters: tuple[Parameter, ...]

    @property
    def label(self) -> str:
        """Return identifier:site."""
        return f'{self.effect.identifier}:{self.site}'

    @property
    def null(self) -> Array:
        """Return the values at which the effect is absent, (k,)."""
        return np.array([p.null for p in self.parameters])

    @property
    def low(self) -> Array:
        """Return the lower bounds, (k,)."""
        return np.array([p.low for p in self.parameters])

    @property
    def high(self) -> Array:
        """Return the upper bounds, (k,)."""
        return np.array([p.high for p in self.parameters])

    @property
    def is_fitted(self) -> bool:
        """Return whether any parameter is free."""
        return bool(np.any(self.low < self.high))

    @property
    def fixed_values(self) -> tuple[float, ...]:
        """Return the values of the fixed parameters."""
        return tuple(p.low for p in self.parameters if p.low == p.high)

    @property
    def switches(self) -> tuple[bool, ...]:
        """Return whether each switched parameter is at null."""
        return tuple(p.low == p.high for p in self.parameters if p.switched)

    @property
    def typical_deviation(self) -> Array:
        """Return the smallest deviation from null among the starts, else the typical one, (k,)."""
        return np.array([min((abs(s - p.null) for s in p.starts if s != p.null),
                             default=p.typical) for p in self.parameters])

    @property
    def is_size(self) -> Array:
        """Return True where a parameter is a size of the effect, False where a shape, (k,)."""
        return np.array([math.isfinite(p.smallest) for p in self.parameters])

    @property
    def event_index(self) -> int | None:
        """Return the index of the time at which an event happens; None if it is no event."""
        names = [p.name for p in self.parameters]
        return names.index(self.effect.event_time) if self.effect.event_time else None

    def prior(self, duration: float) -> ParameterPrior:
        """Return the prior of the parameters for a record of a duration, s."""
        # Times are uniform over the record: a Gaussian with that mean and standard deviation.
        is_time = [not math.isfinite(p.typical) for p in self.parameters]
        fixed = self.low == self.high
        centre = np.where(fixed, self.low, np.where(is_time, 0.5 * duration, self.null))
        width = np.where(is_time, duration / math.sqrt(12.0),
                         [p.typical for p in self.parameters])
        width = np.where(fixed, FIXED_WIDTH, width)
        low = np.where(fixed | is_time, -np.inf, self.low - centre)
        high = np.where(fixed | is_time, np.inf, self.high - centre)
        # An optional parameter is at null with probability 1/2.
        spiked = ~fixed & np.array([p.optional for p in self.parameters])
        # `EventGrid` integrates over events of the likeliest width alone, and all durations.
        lasts = np.array([p.name == self.effect.event_duration for p in self.parameters])
        known = fixed | is_time | (~lasts & (self.event_index is not None))
        spread = np.where(known, 0.0, WIDTH_SPREAD)
        return ParameterPrior(centre, width, low, high, spiked, spread)

    def difference_steps(self, values: Array) -> Array:
        """
        Return the steps of finite differences at values, (k,).

        A share of the deviation from null; for a shape on a grid (a time, a number of periods), a
        share of the grid's spacing.
        """
        steps = DIFFERENCE_SHARE * np.maximum(
            np.abs(values - self.null), 0.2 * self.typical_deviation)
        for k, parameter in enumerate(self.parameters):
            if len(parameter.starts) >= MIN_GRID_STARTS and not self.is_size[k]:
                spacing = float(np.min(np.diff(np.unique(parameter.starts))))
                steps[k] = DIFFERENCE_SHARE * spacing
        return np.where(values + steps > self.high, -steps, steps)

    @property
    def shape_grid(self) -> Array:
        """Return the grid over all shape parameters but a time, sizes at null, (S, k)."""
        grids = [(p.null,) if size or k == self.event_index else (p.low,) if p.low == p.high
                 else p.starts for k, (p, size) in enumerate(zip(self.parameters, self.is_size))]
        return np.array(list(product(*grids)))

    def event_duration(self, values: Array) -> float:
        """Return how long an event with values (k,) takes, s."""
        names = [p.name for p in self.parameters]
        return float(values[names.index(self.effect.event_duration)]) \
            if self.effect.event_duration else 0.0

    def event_share(self, time: Array, values: Array) -> Array:
        """Return the share of an event with values (k,) that has happened at times, s, (N,)."""
        late, duration = time - values[self.event_index], self.event_duration(values)
        return np.asarray(
            np.clip(late / duration, 0.0, 1.0) if duration > 0.0 else 1.0 * (late >= 0.0))

    def probe_deviations(self) -> list[Array]:
        """Return the deviations from null at which sensitivities are taken, (k,) each."""
        of_each = [sorted({s - p.null for s in p.starts if p.low <= s <= p.high} - {0.0}, key=abs)
                   if size else [0.0] for p, size in zip(self.parameters, self.is_size)]
        most = max(map(len, of_each))
        return [np.array([d[min(m, len(d) - 1)] for d in of_each]) for m in range(most)]

    def effect_at(self, values: Array) -> Effect:
        """Return the effect with values (k,), or a batch of effects with (B, k)."""
        if values.ndim == 1:
            return self.effect(self.site, tuple(float(v) for v in values))
        return self.effect(self.site, tuple(values[:, k:k + 1] for k in range(values.shape[1])))


class CauseSet:
    """
    Hypotheses that hold together; their parameters are concatenated, (k,).

    Parameters
    ----------
    hypotheses : sequence of Hypothesis
    duration : float
        Of the longest record, s.

    Attributes
    ----------
    boundaries : Array
        Where the parameters of each hypothesis begin, and the end of the last, int.

    """

    def __init__(self, hypotheses: Sequence[Hypothesis], duration: float):
        self.hypotheses, self.duration = tuple(hypotheses), duration
        self.boundaries = np.cumsum([0, *(len(h.parameters) for h in self.hypotheses)])

    def _joined(self, parts: Sequence[Array]) -> Array:
        return np.concatenate([np.zeros(0), *parts])

    @cached_property
    def prior(self) -> ParameterPrior:
        """Return the prior of all parameters."""
        priors = [h.prior(self.duration) for h in self.hypotheses]
        return ParameterPrior(*(self._joined([getattr(p, field.name) for p in priors])
                                for field in fields(ParameterPrior)))

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Return the lower and the upper bounds, (k,) each."""
        return (self._joined([h.low for h in self.hypotheses]),
                self._joined([h.high for h in self.hypotheses]))

    @property
    def structural(self) -> bool:
        """Tell whether predictions with different values cannot be batched."""
        return any(h.effect.structural for h in self.hypotheses)

    def split(self, values: Array) -> list[Array]:
        """Return values (…, k) split by hypothesis."""
        return [values[..., a:b] for a, b in zip(self.boundaries, self.boundaries[1:])]

    def effects(self, values: Array) -> tuple[Effect, ...]:
        """Return the effects with values (k,), or batches of effects with (B, k)."""
        return tuple(h.effect_at(v) for h, v in zip(self.hypotheses, self.split(values)))

    def difference_steps(self, values: Array) -> Array:
        """Return the steps of finite differences at values, (k,)."""
        return self._joined([h.difference_steps(v)
                             for h, v in zip(self.hypotheses, self.split(values))])

    def residual(self, likelihood: Likelihood, values: Array) -> Array:
        """Return the residual r at values (B, k), (B, m, N); see `Likelihood`."""
        # An arm whose shapes are not the trajectory's has a trajectory of its own, one at a time.
        if self.structural or not self.hypotheses \
                or likelihood.changes_shapes(self.effects(values[0])):
            return np.concatenate([likelihood.residual(self.effects(v)) for v in values])
        return np.concatenate([likelihood.residual(self.effects(values[k:k + BATCH_SIZE]))
                               for k in range(0, len(values), BATCH_SIZE)])


def all_hypotheses(robot: Robot, exclude: Sequence[str] = ()) -> tuple[Hypothesis, ...]:
    """Return a hypothesis for each effect, site and discrete value that a robot can have."""
    return tuple(Hypothesis(effect, site, parameters)
                 for name, effect in catalogue().items() if name not in exclude
                 for site in sites(effect, robot)
                 for parameters in product(*(p.kinds for p in effect.at(site, robot))))
