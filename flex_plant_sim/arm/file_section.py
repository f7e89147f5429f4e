"""
One mapping of a robot file: its keys are read and checked one by one.

`robot_file` builds the robot from such sections. Errors name a key with its file and full path.
"""

from __future__ import annotations

from difflib import get_close_matches
import math
from typing import Any
from unicodedata import category

from msg_config.errors import InputError

# Least and largest plausible magnitude of each key, in the key's unit, for anything from an arm
# on a bench to a crane. A value outside has a wrong unit or decimal point.
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
    'offset_m': (1e-5, 5.0),
    'tolerances.gauge_position_m': (1e-9, 1.0), 'tolerances.strain_bias': (1e-14, 1e-2),
    'tolerances.payload_inertia_kg_m2': (1e-12, 1e3), 'tolerances.angle_zero_rad': (1e-9, 1.0),
    # Relative standard deviations. Above 3 the nominal value would say nothing about the true
    # one: the number was probably meant as per cent.
    **{f'tolerances.{key}': (1e-9, 3.0) for key in (
        'stiffness', 'damping', 'link_mass', 'drive_inertia', 'drive_gain', 'drive_damping',
        'elbow_mass', 'elbow_inertia', 'strain_gain', 'payload', 'length')}}
# Keys, and sections of keys, that may also be zero: what an arm may not have, or is exactly known.
MAY_BE_ZERO = frozenset({
    'damping_ratio', 'hub_radius_m', 'damping_n_m_s', 'friction_n_m_s', 'tacho_gain_v_s',
    'mass_kg', 'elbow.inertia_kg_m2', 'payload.inertia_kg_m2', 'offset_m',
    'tolerances'})
# SI prefixes that the hint on an implausible value suggests, by factor.
SI_PREFIXES = {1e-3: 'milli', 1e-6: 'micro', 1e3: 'kilo', 1e6: 'mega', 1e9: 'giga'}


def plausible(path: str, key: str) -> tuple[float, float]:
    """Return the least and largest plausible magnitude of a key of a section; infinite if none."""
    return PLAUSIBLE.get(f'{path}.{key}', PLAUSIBLE.get(key, (-math.inf, math.inf)))


def may_be_zero(path: str, key: str) -> bool:
    """Return whether a key of a section may also be zero."""
    return not MAY_BE_ZERO.isdisjoint({path, key, f'{path}.{key}'})


class Section:
    """
    One mapping of the file; a key that was read is removed from `data`.

    Attributes
    ----------
    source : str
        Name of the file, for error messages.
    path : str
        Dotted path of the mapping in the file; empty at the top.
    data : dict
        Keys that have not been read yet, with their values.
    left_out : dict
        Defaults of the numbers that the whole file leaves out, by full key; shared by all
        sections of a file.

    """

    def __init__(self, source: str, path: str, data: Any,
                 left_out: dict[str, float] | None = None):
        if not isinstance(data, dict):
            raise InputError(f'{source}: {path or "file"}: expected a mapping, got {shown(data)}')
        self.source, self.path, self.data = source, path, dict(data)
        self.left_out: dict[str, float] = {} if left_out is None else left_out
        self._known_keys: list[str] = []

    def name(self, key: str) -> str:
        """Return the file name and the full path of a key."""
        return f'{self.source}: {self.path}.{key}' if self.path else f'{self.source}: {key}'

    def take(self, key: str, default: Any = None) -> Any:
        """
        Return the value of a key and remove the key from the section.

        Raises
        ------
        InputError
            The key is missing and has no default; suggests a key with a similar name.

        """
        self._known_keys.append(key)
        if key not in self.data and default is None:
            raise InputError(f'{self.name(key)}: expected a value, the key is missing'
                             f'{_similar_key_hint(key, list(self.data))}')
        return self.data.pop(key, default)

    def section(self, key: str, default: Any = None) -> Section:
        """Return the mapping under a key as a section."""
        path = f'{self.path}.{key}' if self.path else key
        return Section(self.source, path, self.take(key, default), self.left_out)

    def text(self, key: str, default: str | None = None) -> str:
        """Return the text of a key: not empty, at most 200 characters, no control characters."""
        value = self.take(key, default)
        if isinstance(value, (dict, list)) or value is None or not str(value).strip() \
                or len(str(value)) > 200:
            raise InputError(f'{self.name(key)}: expected a name, got {shown(value)}')
        # A column may bear the spaces of any script; XML and terminals can hold no controls.
        if not all(c.isprintable() or category(c) == 'Zs' for c in str(value)):
            raise InputError(f'{self.name(key)}: expected a name of printable characters, got '
                             f'{shown(value)}')
        return str(value)

    def number(self, key: str, low: float = 0.0, default: float | None = None) -> float:
        """Return a finite number > low, or >= low if it may be zero, plausible for its key."""
        if default is not None and key not in self.data:
            self.left_out[f'{self.path}.{key}'] = default
            return float(self.take(key, default))
        value = self._number_from(key, self.take(key), low, not may_be_zero(self.path, key))
        least, most = plausible(self.path, key)
        if value and not least <= abs(value) <= most:
            zero = '0, or ' if may_be_zero(self.path, key) else ''
            raise InputError(f'{self.name(key)}: expected {zero}{least:g} to {most:g}, got '
                             f'{value:g}{_unit_prefix_hint(value, least, most)}')
        return value

    def any_number(self, key: str) -> float:
        """Return a finite number."""
        return self._number_from(key, self.take(key), -math.inf, True)

    def numbers(self, key: str, low: float, high: float) -> tuple[float, ...]:
        """Return a list of finite numbers, each from low to high."""
        values = self.take(key)
        if not isinstance(values, list):
            raise InputError(f'{self.name(key)}: expected a list of numbers, got {shown(values)}')
        checked = tuple(self._number_from(key, value, low, False) for value in values)
        if any(value > high for value in checked):
            raise InputError(f'{self.name(key)}: expected at most {high:g}, got {max(checked):g}')
        return checked

    def _number_from(self, key: str, value: Any, low: float, strict: bool) -> float:
        sign = '>' if strict else '>='
        wrong = InputError(f'{self.name(key)}: expected a number {sign} {low:g}, '
                           f'got {shown(value)}{_decimal_comma_hint(value)}')
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
        Check that every key of the section has been read.

        Raises
        ------
        InputError
            A key is unknown; names it and suggests a known key with a similar name.

        """
        if self.data:
            key = sorted(map(str, self.data))[0]
            raise InputError(f'{self.name(key[:80])}: unknown key'
                             f'{_similar_key_hint(key, self._known_keys)}')


def shown(value: Any) -> str:
    """Return a value as text of at most 80 characters, for an error message."""
    text = repr(value) if isinstance(value, (str, int, float, bool, type(None))) \
        or len(value) <= 4 else f'{type(value).__name__} of {len(value)}'
    return text if len(text) <= 80 else f'{text[:77]}...'


def _similar_key_hint(key: str, others: list[str]) -> str:
    found = get_close_matches(key[:80], [str(other)[:80] for other in others[:100]], 1, 0.6)
    return f' (is it {found[0]!r}?)' if found else ''


def _decimal_comma_hint(value: Any) -> str:
    if isinstance(value, str) and value.count(',') == 1 and \
            value.replace(',', '').strip('+-').isdigit():
        return ' (decimal comma? write a point)'
    return ''


def _unit_prefix_hint(value: float, least: float, most: float) -> str:
    fits = [name for factor, name in SI_PREFIXES.items() if least <= abs(value) * factor <= most]
    return f' (is the unit {" or ".join(f"{name}…" for name in fits)}?)' if fits else ''
