"""Which part seems to change during a record, where that is the likeliest of what has no name."""

from __future__ import annotations

import math

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.gauss_newton import part_constancy
from flex_plant_sim.diagnosis.causes.posterior import shown_by_parts
from flex_plant_sim.diagnosis.causes.search import SearchResult
from flex_plant_sim.diagnosis.causes.search_state import MAX_DEFICIT
from flex_plant_sim.diagnosis.verdict.wording import digits_text, label_text, shown_unit
import numpy as np


def varying_part_text(found: SearchResult) -> str:
    """Return which part, or which of several, changes from the first to the last window."""
    best, fit = found.best, found.best.fit
    # What shows less than a cause of one in twenty is not worth a word.
    if not fit.discrepancy.remainder or shown_by_parts(fit) < max(MAX_DEFICIT, fit.varying_gain):
        return ''
    gains = fit.varying_part_gains
    constancy = part_constancy(best.likelihood, best.point, fit.statistics, fit.error_scale)
    likely = [k for k in np.argsort(-gains) if gains[k] > np.max(gains) - MAX_DEFICIT]
    texts = [_change_text(best.likelihood.parts[k].name, best.likelihood.parts[k].unit,
                          constancy.course(int(k))) for k in likely]
    return f' Something seems to change during the record: {", or ".join(texts)}.'


def _change_text(name: str, unit: str, course: Array) -> str:
    """Return a part and by how much it changes over the windows, (W,)."""
    change = float(course[-1] - course[0])
    scale, shown = shown_unit(unit) if unit else (100.0, '%')
    size = scale * (change if unit else math.expm1(change))
    sign = '+' if size >= 0.0 else ''
    return f'{label_text(name)} by {sign}{digits_text(size, 2)} {shown}'
