"""Numbers as a reader wants them: rounded to their uncertainty, with their unit."""

from __future__ import annotations

import math

from flex_plant_sim.diagnosis.verdict.results import ParameterValue

# Of half the interval: a value further from its middle is told with both ends.
LOPSIDED = 0.3


def unit_text(unit: str) -> str:
    """Return a unit with its factors joined by dots; units in words stay."""
    symbols = all(len(part) <= 4 for part in unit.replace('/', ' ').split())
    return (unit.replace(' ', '·') if symbols else unit).replace('^2', '²').replace('^3', '³')


def rounded(value: float, uncertainty: float) -> str:
    """Return a value with the decimals that its uncertainty leaves, two digits of it."""
    if not (uncertainty > 0.0 and math.isfinite(uncertainty)):
        return f'{value:.4g}'
    decimals = 1 - math.floor(math.log10(uncertainty))
    if not -3 <= -decimals <= 3 or abs(value) >= 1e6:
        digits = max(1, math.floor(math.log10(max(abs(value), uncertainty))) + decimals + 1)
        return f'{value:.{digits}g}'
    return f'{value:.{max(decimals, 0)}f}'


def interval_text(parameter: ParameterValue) -> str:
    """Return 0.430 ± 0.021 N·m, or 0.43 (0.40 to 0.52) N·m where the interval is lopsided."""
    low, value, high = parameter.low, parameter.value, parameter.high
    half, unit = 0.5 * (high - low), unit_text(parameter.unit)
    if not (math.isfinite(half) and half > 0.0):
        return f'{value:.4g} {unit}'.rstrip()
    if abs(0.5 * (high + low) - value) > LOPSIDED * half:
        low_text, high_text = rounded(low, half), rounded(high, half)
        return f'{rounded(value, half)} ({low_text} to {high_text}) {unit}'.rstrip()
    return f'{rounded(value, half)} ± {rounded(half, half)} {unit}'.rstrip()


def size_text(value: float, unit: str) -> str:
    """Return a size with three digits and its unit."""
    return f'{value:.3g} {unit_text(unit)}'.rstrip()


def name_text(name: str, site: str = '') -> str:
    """Return coulomb_friction at joint_2 as a reader says it."""
    words = name.replace('_', ' ')
    return words if site in ('', 'arm') else f'{words}, {site.replace("_", " ")}'


def percent_text(share: float) -> str:
    """Return a share as a percentage without false precision."""
    if share >= 0.995:
        return '> 99 %'
    return '< 1 %' if share < 0.005 else f'{100.0 * share:.0f} %'
