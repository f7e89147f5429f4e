"""A hypothesis: one effect of the catalogue at one site, where its fit starts; and several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
import math

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.likelihood.evidence import ParameterPrior
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.effects import catalogue, sites
from flex_plant_sim.effects.base import Effect, Parameter
import numpy as np

# Of a deviation: what bends a prediction is small over it, rounding is smaller.
DIFFERENCE_SHARE = 0.05
# At least and at most so many times of an event; a shape with GRID starts is searched on a grid.
MIN_GRID_STARTS, EVENT_GRID_TIMES = 5, 30
# Of its unit: the slab of a parameter that is held is as good as a point.
FIXED_WIDTH = 1e-9
# Arms that run at once: memory goes with them.
BATCH_SIZE = 8


@dataclass(frozen=True)
class Hypothesis:
    """
    An effect at a site, with its parameters as they can be on the robot.

    One of few values (`Parameter.discrete`) is held: its bounds coincide, and each value is a
    hypothesis of its own, under the same label.
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
    def fixed_values(self) -> tuple[float, ...]:
        """Return the values of the parameters that are held."""
        return tuple(p.low for p in self.parameters if p.low == p.high)

    @property
    def typical_deviation(self) -> Array:
        """Return the size of a typical deviation from null, (k,)."""
        is_size = []
        for p in self.parameters:
            away = [abs(s - p.null) for s in p.starts if s != p.null]
            is_size.append(min(away) if away else max(abs(p.null), 1.0))
        return np.array(is_size)

    @property
    def is_size(self) -> Array:
        """Return True where a parameter measures the effect's size, False for its shape, (k,)."""
        return np.array([math.isfinite(p.smallest) for p in self.parameters])

    @property
    def event_index(self) -> int | None:
        """Return which parameter says when it happens, if it is an event."""
        names = [p.name for p in self.parameters]
        return names.index(self.effect.event_time) if self.effect.event_time else None

    def as_sudden(self, values: Array) -> Array:
        """Return values (k,) with an event that takes its time at once in the middle of it."""
        found, names = values.copy(), [p.name for p in self.parameters]
        if self.effect.event_duration:
            place = names.index(self.effect.event_duration)
            found[names.index(self.effect.event_time)] += 0.5 * values[place]
            found[place] = 0.0
        return found

    def prior(self, duration: float) -> ParameterPrior:
        """Return the prior of the parameters in a record of a duration, s."""
        anywhere = [not math.isfinite(p.typical) for p in self.parameters]
        held = self.low == self.high
        centre = np.where(held, self.low, np.where(anywhere, 0.5 * duration, self.null))
        # A time is uniform over the record: mean and deviation of that.
        width = np.where(anywhere, duration / math.sqrt(12.0),
                         [p.typical for p in self.parameters])
        width = np.where(held, FIXED_WIDTH, width)
        above, below = self.low >= self.null, self.high <= self.null
        one_sided = np.where(held | anywhere, 0.0, 1.0 * above - 1.0 * below)
        # What nature may add to an effect is there or not.
        spiked = ~held & np.array([p.optional for p in self.parameters])
        return ParameterPrior(centre, width, one_sided, spiked)

    def difference_steps(self, values: Array) -> Array:
        """
        Return difference steps at values, (k,).

        A share of the deviation from null; for a shape that is searched on a grid (a time, a
        count of periods) a share of the grid's spacing, however far from null it is.
        """
        difference_steps = DIFFERENCE_SHARE * np.maximum(np.abs(values - self.null), 0.2 * self.typical_deviation)
        for k, parameter in enumerate(self.parameters):
            if len(parameter.starts) >= MIN_GRID_STARTS and not self.is_size[k]:
                difference_steps[k] = DIFFERENCE_SHARE * float(np.min(np.diff(np.unique(parameter.starts))))
        return np.where(values + difference_steps > self.high, -difference_steps, difference_steps)

    def shape_grid(self, duration: float) -> Array:
        """Return the grid over the parameters that are no size, sizes at null, (S, k)."""
        grids = [(p.null,) if size else (p.low,) if p.low == p.high else self._grid(p, duration)
                 for p, size in zip(self.parameters, self.is_size)]
        return np.array(list(product(*grids)))

    def probe_deviations(self) -> list[Array]:
        """Return deviations from null at which to look, one set for all sizes at once, (k,)."""
        some = [sorted({s - p.null for s in p.starts if p.low <= s <= p.high} - {0.0}, key=abs)
                if size else [0.0] for p, size in zip(self.parameters, self.is_size)]
        most = max(map(len, some))
        return [np.array([s[min(m, len(s) - 1)] for s in some]) for m in range(most)]

    @staticmethod
    def _grid(parameter: Parameter, duration: float) -> Sequence[float]:
        if math.isfinite(parameter.typical):
            return parameter.starts
        spacing = float(np.min(np.diff(parameter.starts)))
        count = int(np.clip(duration / spacing, MIN_GRID_STARTS, EVENT_GRID_TIMES))
        return tuple(duration * k / count for k in range(1, count))

    def effect_at(self, values: Array) -> Effect:
        """Return the effect with values (k,), or a batch of them with (B, k)."""
        if values.ndim == 1:
            return self.effect(self.site, tuple(float(v) for v in values))
        return self.effect(self.site, tuple(values[:, k:k + 1] for k in range(values.shape[1])))


class CauseSet:
    """
    Some hypotheses at once; their parameters lie side by side, (k,).

    Parameters
    ----------
    hypotheses : sequence of Hypothesis
    duration : float
        Of the longest record, s.

    """

    def __init__(self, hypotheses: Sequence[Hypothesis], duration: float):
        self.hypotheses, self.duration = tuple(hypotheses), duration
        self.boundaries = np.cumsum([0, *(len(h.parameters) for h in self.hypotheses)])

    def _joined(self, parts: Sequence[Array]) -> Array:
        return np.concatenate([np.zeros(0), *parts])

    @cached_property
    def prior(self) -> ParameterPrior:
        """Return the prior of all parameters."""
        slabs = [h.prior(self.duration) for h in self.hypotheses]
        return ParameterPrior(*(self._joined([getattr(s, part) for s in slabs])
                      for part in ('centre', 'width', 'one_sided', 'spiked')))

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Return the lower and the upper bounds, (k,) each."""
        return (self._joined([h.low for h in self.hypotheses]),
                self._joined([h.high for h in self.hypotheses]))

    @property
    def structural(self) -> bool:
        """Tell whether values must come one by one."""
        return any(h.effect.structural for h in self.hypotheses)

    def split(self, values: Array) -> list[Array]:
        """Return values (…, k) as each hypothesis has them."""
        return [values[..., a:b] for a, b in zip(self.boundaries, self.boundaries[1:])]

    def effects(self, values: Array) -> tuple[Effect, ...]:
        """Return the effects with values (k,), or batches of them with (B, k)."""
        return tuple(h.effect_at(v) for h, v in zip(self.hypotheses, self.split(values)))

    def as_sudden(self, values: Array) -> Array:
        """Return values (k,) with all events at once, see Hypothesis."""
        return self._joined([h.as_sudden(v) for h, v in zip(self.hypotheses, self.split(values))])

    def difference_steps(self, values: Array) -> Array:
        """Return difference steps at values, (k,)."""
        return self._joined([h.difference_steps(v) for h, v in zip(self.hypotheses, self.split(values))])

    def residual(self, likelihood: Likelihood, values: Array) -> Array:
        """Return the residuals at values (B, k): (B, m, N)."""
        if self.structural or not self.hypotheses:
            return np.concatenate([likelihood.residual(self.effects(v)) for v in values])
        return np.concatenate([likelihood.residual(self.effects(values[k:k + BATCH_SIZE]))
                               for k in range(0, len(values), BATCH_SIZE)])


def all_hypotheses(robot: Robot, exclude: Sequence[str] = ()) -> tuple[Hypothesis, ...]:
    """Return every effect of the catalogue at every site of a robot, each value of those held."""
    return tuple(Hypothesis(effect, site, parameters)
                 for name, effect in catalogue().items() if name not in exclude
                 for site in sites(effect, robot) for parameters in product(*(
                     [replace(p, low=value, high=value) for value in p.starts]
                     if p.discrete else [p] for p in effect.at(site, robot))))
