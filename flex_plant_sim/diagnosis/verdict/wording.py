"""Numbers and names in words: values rounded to their uncertainty, with their unit."""

from __future__ import annotations

from collections.abc import Sequence
import math

from flex_plant_sim.arm.units import SHOWN
from flex_plant_sim.diagnosis.verdict.results import ParameterValue, PartEstimate
from flex_plant_sim.interval import Z95
import numpy as np

# Distance of a value from the middle of its interval, as a share of half of it, from which on both
# ends are stated.
MAX_ASYMMETRY = 0.3
# From this factor on a deviation is written as one: a percentage has no symmetric interval there.
FACTOR = 2.0


def unit_text(unit: str) -> str:
    """Return a unit with its factors joined by dots; units that are words stay as they are."""
    symbols = all(len(part) <= 4 for part in unit.replace('/', ' ').split())
    return (unit.replace(' ', '·') if symbols else unit).replace('^2', '²').replace('^3', '³')


def shown_unit(unit: str) -> tuple[float, str]:
    """Return factor and name of the unit in which a quantity is shown."""
    return SHOWN.get(unit, (1.0, unit_text(unit)))


def key_text(key: str, unit: str) -> str:
    """Return a key without its unit, compliance_rad_per_n_m in rad/(N m) as compliance."""
    spelt = unit.lower().replace('/', ' per ')
    whole = '_'.join(''.join(c for c in spelt if c not in '()^').split())
    whole = whole.removeprefix('1_').removeprefix('m_per_m_')
    for suffix in (whole, whole.partition('_per_')[0]):
        key = key.removesuffix(f'_{suffix}')
    return key.replace('_', ' ')


def parameter_text(parameter: ParameterValue) -> str:
    """Return a parameter's name, value and interval."""
    return f'{key_text(parameter.name, parameter.unit)} {interval_text(parameter)}'


def digits_text(value: float, digits: int) -> str:
    """Return a value with so many digits; written out where it is neither tiny nor huge."""
    if 1e-4 <= abs(value) < 1e6:
        return np.format_float_positional(value, precision=digits, unique=False,
                                          fractional=False, trim='-')
    return f'{value:.{digits}g}'


def rounded(value: float, uncertainty: float) -> str:
    """Return a value with as many decimals as two digits of its uncertainty."""
    if not (uncertainty > 0.0 and math.isfinite(uncertainty)):
        return f'{value:.4g}'
    decimals = 1 - math.floor(math.log10(uncertainty))
    if not -6 <= -decimals <= 3 or abs(value) >= 1e6:
        digits = max(1, math.floor(math.log10(max(abs(value), uncertainty))) + decimals + 1)
        return f'{value:.{digits}g}'
    return f'{value:.{max(decimals, 0)}f}'


def interval_text(parameter: ParameterValue) -> str:
    """
    Return 0.430 ± 0.021 N·m, or 0.43 (0.40 to 0.52) N·m where the interval is lopsided.

    Of a parameter with few values, those that are credible: strain_2a (78 %) or strain_2b (20 %).
    """
    low, value, high = parameter.low, parameter.value, parameter.high
    if parameter.choices:
        return choices_text(parameter.choices)
    half, (scale, unit) = 0.5 * (high - low), shown_unit(parameter.unit)
    low, value, high, half = (scale * x for x in (low, value, high, half))
    if not (math.isfinite(half) and half > 0.0):
        return f'{value:.4g} {unit}'.rstrip()
    if abs(0.5 * (high + low) - value) > MAX_ASYMMETRY * half:
        low_text, high_text = rounded(low, half), rounded(high, half)
        return f'{rounded(value, half)} ({low_text} to {high_text}) {unit}'.rstrip()
    return f'{rounded(value, half)} ± {rounded(half, half)} {unit}'.rstrip()


def choices_text(choices: Sequence[tuple[str, float]]) -> str:
    """Return names with their probabilities; a name alone where no other is credible."""
    if len(choices) == 1:
        return choices[0][0]
    return ' or '.join(f'{name} ({percent_text(p)})' for name, p in choices)


def size_text(value: float, unit: str) -> str:
    """Return a size with three digits and its unit."""
    scale, name = shown_unit(unit)
    return f'{digits_text(scale * value, 3)} {name}'.rstrip()


def name_text(name: str, site: str = '') -> str:
    """Return a name and its site in words: coulomb friction, joint 2."""
    words = name.replace('_', ' ')
    return words if site in ('', 'arm') else f'{words}, {site.replace("_", " ")}'


def label_text(label: str) -> str:
    """Return a label in words: coulomb friction, joint 2, of coulomb_friction:joint_2."""
    return name_text(*label.partition(':')[::2])


def set_text(labels: Sequence[str]) -> str:
    """Return a set of labels in words."""
    words = [label_text(label) for label in labels]
    return ' + '.join(words) or 'nothing wrong'


def part_text(part: PartEstimate) -> str:
    """Return a part's deviation, at 95 %, and its tolerance as the robot file has it."""
    name, reach = label_text(part.name), Z95 * part.deviation
    scale, unit = shown_unit(part.unit) if part.unit else (100.0, '%')
    mean = scale * (part.mean if part.unit else math.expm1(part.mean))
    written = f'; of the velocity loop: {part.written}' if part.written else ''
    told = f'(tolerance {digits_text(scale * part.prior, 2)} {unit}{written})'
    if not part.unit and abs(part.mean) > math.log(FACTOR):
        low, value, high = (digits_text(math.exp(part.mean + side * reach), 2)
                            for side in (-1.0, 0.0, 1.0))
        return f'{name} times {value} ({low} to {high}) {told}'
    return (f'{name} {"+" if mean >= 0.0 else ""}{digits_text(mean, 3)} '
            f'± {digits_text(scale * reach, 2)} {unit} {told}')


def beyond_tolerance(parts: Sequence[PartEstimate]) -> list[PartEstimate]:
    """Return the parts that are further off than 95 % of good parts."""
    return [part for part in parts if abs(part.mean) > Z95 * part.prior]


def apart_text(names: Sequence[str]) -> str:
    """Return names to be told apart: this from that or that."""
    first, *others = map(name_text, names)
    return f'{first} from {" or ".join(others)}'


def percent_text(share: float) -> str:
    """Return a share as a percentage without false precision."""
    if share >= 0.995:
        return '> 99 %'
    return '< 1 %' if share < 0.005 else f'{100.0 * share:.0f} %'
