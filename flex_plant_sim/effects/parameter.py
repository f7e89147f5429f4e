"""Parameters of effects: their bounds, starts and sizes, and their values in a robot file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import Any

from msg_config.errors import InputError


@dataclass(frozen=True)
class Parameter:
    """
    A parameter of an effect; its numbers are for the reference robot, see robot_scale.

    Attributes
    ----------
    name : str
        Name in the robot file, with the unit at its end, for example level_n_m.
    unit : str
    null : float
        The value at which the effect is absent.
    low, high : float
        Bounds.
    starts : tuple of float
        Values from which a fit starts. The fit of a far size may end at a near one, so that they
        reach at least a third of what is to be named, four detection limits.
    smallest : float
        Smallest deviation from null that matters in practice; inf if the parameter only shapes
        an effect whose size another parameter gives.
    typical : float
        Likeliest standard deviation of the Gaussian prior around null: 68 % of the conceivable
        sizes on robots of this kind are within it. The prior of a parameter that cannot be below
        null is the upper half of that Gaussian. inf for a time, which may be anywhere in the
        record.
    optional : bool
        Whether a robot file may leave it out; it then has its null value.
    discrete : bool
        Whether the true value is one of `starts`, all equally likely, and never between.
    switched : bool
        Whether the parameter is at null or beyond the least of `starts`, equally likely, each a
        hypothesis of its own: at null the effect has another structure.
    meaning : str
        What its values stand for, where the name does not say.
    value_names : tuple of str
        What each of `starts` is called, if it is discrete and has no number for a reader.

    """

    name: str
    unit: str
    null: float
    low: float
    high: float
    starts: tuple[float, ...]
    smallest: float
    typical: float
    optional: bool = False
    discrete: bool = False
    switched: bool = False
    meaning: str = ''
    value_names: tuple[str, ...] = ()

    @property
    def kinds(self) -> tuple[Parameter, ...]:
        """Return the parameter as it is in each hypothesis of the effect."""
        fixed = self.starts if self.discrete else (self.null,) if self.switched else ()
        found = [replace(self, low=value, high=value) for value in fixed]
        if self.switched:
            found.append(replace(self, low=min(self.starts), optional=False))
        return tuple(found) or (self,)

    def value_text(self, value: float) -> str:
        """Return what a discrete value is called."""
        return self.value_names[self.starts.index(value)] if self.value_names else f'{value:g}'

    def scaled(self, factor: float) -> Parameter:
        """Return the parameter with its sizes multiplied by a factor, see robot_scale."""
        if factor == 1.0:
            return self
        return replace(self, null=factor * self.null, low=factor * self.low,
                       high=factor * self.high, smallest=factor * self.smallest,
                       typical=factor * self.typical,
                       starts=tuple(factor * start for start in self.starts))


def full_name(name: str, known: Sequence[str]) -> str:
    """Return the full name of a parameter given without its unit (level for level_n_m)."""
    longer = [full for full in known if full.startswith(f'{name}_')]
    return longer[0] if name not in known and len(longer) == 1 else name


def given_value(identifier: str, parameter: Parameter, values: Mapping[str, Any]) -> float:
    """Return the value of a parameter, from those of a robot file; see `Effect.read`."""
    name = f'effects: {identifier}: {parameter.name}'
    if parameter.name not in values and parameter.optional:
        return parameter.null
    if parameter.name not in values:
        wanted = f'a value in {parameter.unit}' if parameter.unit else 'a number'
        raise InputError(f'{name}: expected {wanted}, it is missing')
    given = values[parameter.name]
    if not isinstance(given, (int, float)):
        raise InputError(f'{name}: expected a number, got {given!r}')
    value = float(given)
    if not (math.isfinite(value) and parameter.low <= value <= parameter.high):
        unit = f' {parameter.unit}' if parameter.unit else ''
        raise InputError(f'{name}: expected {parameter.low:g} to {parameter.high:g}{unit}, '
                         f'got {value:g}')
    if parameter.discrete and not value.is_integer():
        raise InputError(f'{name}: expected a whole number, got {value:g}')
    return value
