"""A hypothesis: one effect of the catalogue at one site, and where its fit starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
import math

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects import catalogue, sites
from flex_plant_sim.effects.base import Effect, Parameter
import numpy as np

DIFFERENCE = 0.05
GRID = 5
TIMES = 30
TIME = 'time_s'


@dataclass(frozen=True)
class Hypothesis:
    """An effect at a site with free parameters; bounds are what each can be on the robot."""

    effect: type[Effect]
    site: str
    bounds: tuple[tuple[float, float], ...]

    @property
    def label(self) -> str:
        """Return identifier:site."""
        return f'{self.effect.identifier}:{self.site}'

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Return the effect's parameters."""
        return self.effect.parameters

    @property
    def null(self) -> Array:
        """Return the values at which the effect is absent, (k,)."""
        return np.array([p.null for p in self.parameters])

    @property
    def low(self) -> Array:
        """Return the lower bounds, (k,)."""
        return np.array([low for low, _ in self.bounds])

    @property
    def high(self) -> Array:
        """Return the upper bounds, (k,)."""
        return np.array([high for _, high in self.bounds])

    @property
    def scale(self) -> Array:
        """Return the size of a typical deviation from null, (k,)."""
        sizes = []
        for p in self.parameters:
            away = [abs(s - p.null) for s in p.starts if s != p.null]
            sizes.append(min(away) if away else max(abs(p.null), 1.0))
        return np.array(sizes)

    @property
    def sizes(self) -> Array:
        """Return True where a parameter measures the effect's size, False for its shape, (k,)."""
        return np.array([math.isfinite(p.smallest) for p in self.parameters])

    @property
    def is_event(self) -> bool:
        """Tell whether it happens at a time, so that one window may hold all that shows it."""
        return any(p.name == TIME for p in self.parameters)

    def steps(self, values: Array) -> Array:
        """
        Return difference steps at values, (k,).

        A share of the deviation from null; for a shape that is searched on a grid (a time, a
        count of periods) a share of the grid's spacing, however far from null it is.
        """
        steps = DIFFERENCE * np.maximum(np.abs(values - self.null), 0.2 * self.scale)
        for k, parameter in enumerate(self.parameters):
            if len(parameter.starts) >= GRID and not self.sizes[k]:
                steps[k] = DIFFERENCE * float(np.min(np.diff(np.unique(parameter.starts))))
        return np.where(values + steps > self.high, -steps, steps)

    def starts(self, duration: float) -> Array:
        """Return the start values, (S, k); times are spread over the record's duration, s."""
        return np.array(list(product(*(self._grid(p, duration) for p in self.parameters))))

    @staticmethod
    def _grid(parameter: Parameter, duration: float) -> Sequence[float]:
        if parameter.name != TIME:
            return parameter.starts
        spacing = float(np.min(np.diff(parameter.starts)))
        count = int(np.clip(duration / spacing, GRID, TIMES))
        return tuple(duration * k / count for k in range(1, count))

    def at(self, values: Array) -> Effect:
        """Return the effect with values (k,), or a batch of them with (B, k)."""
        if values.ndim == 1:
            return self.effect(self.site, tuple(float(v) for v in values))
        return self.effect(self.site, tuple(values[:, k:k + 1] for k in range(values.shape[1])))

    def relevance(self, values: Array) -> float:
        """Return the size over the smallest that matters: below 1 it does not."""
        smallest = np.array([p.smallest for p in self.parameters])
        return float(np.max(np.abs(values - self.null)[self.sizes] / smallest[self.sizes]))


def hypotheses(robot: Robot, exclude: Sequence[str] = ()) -> tuple[Hypothesis, ...]:
    """Return every effect of the catalogue at every site of a robot."""
    return tuple(Hypothesis(effect, site, effect.bounds(site, robot))
                 for name, effect in catalogue().items() if name not in exclude
                 for site in sites(effect, robot))
