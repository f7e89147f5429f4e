"""One mapping of a robot file: takes keys out, checks them, complains by their full name."""

from __future__ import annotations

from difflib import get_close_matches
import math
from typing import Any

from msg_config.errors import InputError

# Least and largest value that an arm on a bench, or a crane, can have; 0 is judged on its own.
# Outside, a unit or a decimal point is wrong.
PLAUSIBLE = {
    'length_m': (0.01, 20.0), 'thickness_m': (1e-5, 0.2), 'height_m': (1e-4, 1.0),
    'youngs_modulus_pa': (1e6, 1.5e12), 'density_kg_per_m3': (10.0, 3e4),
    'damping_ratio': (1e-7, 0.7), 'hub_radius_m': (1e-5, 2.0),
    'inertia_kg_m2': (1e-10, 1e4), 'time_constant_s': (1e-6, 100.0),
    'gain_rad_per_s': (1e-6, 1e4), 'torque_constant_n_m_per_a': (1e-6, 1e5),
    'damping_n_m_s': (1e-9, 1e5), 'command_limit': (1e-6, 1e6), 'mass_kg': (1e-6, 1e3),
    'sample_time_s': (1e-5, 1.0), 'gauge_amplifier_v_per_strain': (1e-3, 1e9),
    'resistance_ohm': (1e-4, 1e5), 'gear_ratio': (1e-2, 1e5), 'rotor_inertia_kg_m2': (1e-12, 1e3),
    'friction_n_m_s': (1e-12, 1e3), 'amplifier_gain': (1e-4, 1e6), 'tacho_gain_v_s': (1e-7, 1e3),
    'angle_noise_rad': (1e-12, 0.2), 'strain_noise': (1e-14, 1e-2),
    'tolerances.gauge_position_m': (1e-9, 1.0), 'tolerances.strain_bias': (1e-14, 1e-2),
    'tolerances.payload_inertia_kg_m2': (1e-12, 1e3),
    # Relative: beyond three times itself a number says nothing, and was meant as per cent.
    **{f'tolerances.{key}': (1e-9, 3.0) for key in (
        'stiffness', 'damping', 'link_mass', 'drive_inertia', 'drive_gain', 'drive_damping',
        'elbow_mass', 'elbow_inertia', 'strain_gain', 'payload', 'length')}}
# By which a number must be multiplied that a unit with a prefix would mean.
PREFIXES = {1e-3: 'milli', 1e-6: 'micro', 1e3: 'kilo', 1e6: 'mega', 1e9: 'giga'}


class Section:
    """
    One mapping of the file.

    Attributes
    ----------
    source : str
        File, for errors.
    path : str
        Of the mapping in the file, with dots.
    data : dict
        What nobody took yet.
    left_out : dict
        Numbers that the file, this section or another, leaves to their defaults, by full key.

    """

    def __init__(self, source: str, path: str, data: Any,
                 left_out: dict[str, float] | None = None):
        if not isinstance(data, dict):
            raise InputError(f'{source}: {path or "file"}: expected a mapping, got {shown(data)}')
        self.source, self.path, self.data = source, path, dict(data)
        self.left_out: dict[str, float] = {} if left_out is None else left_out
        self._asked: list[str] = []

    def name(self, key: str) -> str:
        """Return a key's full name with its file."""
        return f'{self.source}: {self.path}.{key}' if self.path else f'{self.source}: {key}'

    def take(self, key: str, default: Any = None) -> Any:
        """
        Return a key's value and forget it.

        Raises
        ------
        InputError
            The key is missing and has no default; names a key that looks like it.

        """
        self._asked.append(key)
        if key not in self.data and default is None:
            raise InputError(f'{self.name(key)}: expected a value, the key is missing'
                             f'{_alike(key, list(self.data))}')
        return self.data.pop(key, default)

    def section(self, key: str, default: Any = None) -> Section:
        """Return the mapping below a key."""
        path = f'{self.path}.{key}' if self.path else key
        return Section(self.source, path, self.take(key, default), self.left_out)

    def text(self, key: str, default: str | None = None) -> str:
        """Return a word or a line."""
        value = self.take(key, default)
        if isinstance(value, (dict, list)) or value is None or not str(value).strip() \
                or len(str(value)) > 200:
            raise InputError(f'{self.name(key)}: expected a name, got {shown(value)}')
        return str(value)

    def number(self, key: str, low: float = 0.0, default: float | None = None,
               strict: bool = True) -> float:
        """Return a finite number > low (not strict: >= low), plausible for its key."""
        if default is not None and key not in self.data:
            self.left_out[f'{self.path}.{key}'] = default
            return float(self.take(key, default))
        value = self._checked(key, self.take(key), low, strict)
        least, most = PLAUSIBLE.get(f'{self.path}.{key}', PLAUSIBLE.get(
            key, (-math.inf, math.inf)))
        if value and not least <= abs(value) <= most:
            raise InputError(f'{self.name(key)}: expected {least:g} to {most:g}, got {value:g}'
                             f'{_prefix(value, least, most)}')
        return value

    def numbers(self, key: str, low: float, high: float) -> tuple[float, ...]:
        """Return a list of numbers from low to high."""
        values = self.take(key)
        if not isinstance(values, list):
            raise InputError(f'{self.name(key)}: expected a list of numbers, got {shown(values)}')
        checked = tuple(self._checked(key, value, low, False) for value in values)
        if any(value > high for value in checked):
            raise InputError(f'{self.name(key)}: expected at most {high:g}, got {max(checked):g}')
        return checked

    def _checked(self, key: str, value: Any, low: float, strict: bool) -> float:
        sign = '>' if strict else '>='
        wrong = InputError(f'{self.name(key)}: expected a number {sign} {low:g}, '
                           f'got {shown(value)}{_comma(value)}')
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise wrong
        try:
            number = float(value)
        except OverflowError:
            raise wrong from None
        if not math.isfinite(number) or number < low or (strict and number == low):
            raise wrong
        return number

    def close(self) -> None:
        """
        Raise where a key is left that nobody took.

        Raises
        ------
        InputError
            Names the key, and one that looks like it.

        """
        if self.data:
            key = sorted(map(str, self.data))[0]
            raise InputError(f'{self.name(key[:80])}: unknown key{_alike(key, self._asked)}')


def shown(value: Any) -> str:
    """Return a value as text that fits a line."""
    text = repr(value) if isinstance(value, (str, int, float, bool, type(None))) \
        or len(value) <= 4 else f'{type(value).__name__} of {len(value)}'
    return text if len(text) <= 80 else f'{text[:77]}...'


def _alike(key: str, others: list[str]) -> str:
    found = get_close_matches(key[:80], [str(other)[:80] for other in others[:100]], 1, 0.6)
    return f' (is it {found[0]!r}?)' if found else ''


def _comma(value: Any) -> str:
    if isinstance(value, str) and value.count(',') == 1 and \
            value.replace(',', '').strip('+-').isdigit():
        return ' (decimal comma? write a point)'
    return ''


def _prefix(value: float, least: float, most: float) -> str:
    fits = [name for factor, name in PREFIXES.items() if least <= abs(value) * factor <= most]
    return f' (is the unit {fits[0]}…?)' if fits else ''
