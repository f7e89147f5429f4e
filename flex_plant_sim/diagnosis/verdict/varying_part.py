"""Which part seems to change during a record, where that may be what has no name."""

from __future__ import annotations

import math

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.gauss_newton import part_constancy
from flex_plant_sim.diagnosis.causes.posterior import SetKey, shown_by_parts
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.causes.search import SearchResult
from flex_plant_sim.diagnosis.causes.search_state import MAX_DEFICIT, MIN_RELATIVE_PROBABILITY
from flex_plant_sim.diagnosis.verdict.wording import (
    digits_text,
    label_text,
    percent_text,
    shown_unit,
)
import numpy as np


def varying_part_text(found: SearchResult) -> str:
    """Return which part, or which of several, changes from the first to the last window."""
    if found.best.fit.discrepancy.laws:
        # Laws say over what the unnamed changes, time among it.
        return ''
    among = max((found.best, found.nothing), key=lambda refined: _unnamed_share(found, refined))
    fit, share = among.fit, _unnamed_share(found, among)
    # What shows less than a cause of one in twenty is not worth a word.
    shows = shown_by_parts(fit) >= max(MAX_DEFICIT, fit.varying_gain)
    if not shows or share < MIN_RELATIVE_PROBABILITY:
        return ''
    gains, likelihood = fit.varying_part_gains, among.likelihood
    constancy = part_constancy(likelihood, among.point, fit.statistics, fit.error_scale)
    likely = [int(k) for k in np.argsort(-gains) if gains[k] > np.max(gains) - MAX_DEFICIT]
    changes = ', or '.join(_change_text(likelihood.parts[k].name, likelihood.parts[k].unit,
                                        constancy.course(k)) for k in likely)
    lead = 'Something seems' if found.best.fit.discrepancy.remainder else (
        f'Perhaps ({percent_text(share)}) something seems')
    return f' {lead} to change during the record: {changes}.'


def _unnamed_share(found: SearchResult, refined: RefinedFit) -> float:
    """Return the probability of a set with something unnamed besides."""
    key = SetKey.of(refined.fit).without_remainder
    return float(sum(p for fit, p in zip(found.posterior.fits, found.posterior.probability)
                     if fit.discrepancy.remainder and SetKey.of(fit).without_remainder == key))


def _change_text(name: str, unit: str, course: Array) -> str:
    """Return a part and by how much it changes over the windows, (W,)."""
    change = float(course[-1] - course[0])
    scale, shown = shown_unit(unit) if unit else (100.0, '%')
    size = scale * (change if unit else math.expm1(change))
    sign = '+' if size >= 0.0 else ''
    return f'{label_text(name)} by {sign}{digits_text(size, 2)} {shown}'
