"""The payload's score: whether the estimate moves by as much as its variance says."""

from __future__ import annotations

import math

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled

# Memory of the score's sum, s: errors that last longer than this count as if they did not.
CORRELATION_S = 0.5


@compiled
def update_score(sums: Array, change: float, before: float, after: float, step: float) -> None:
    """
    Add what a measurement has done to the payload.

    Where the innovations are white and as large as stated, a change c has the variance V - V+, so
    that g = c / sqrt(V V+) has that of the information gained, h = 1 / V+ - 1 / V. Its sum y with
    a memory then has the variance q, and y^2 / q is 1 on average. Where errors are correlated, the
    sum of y^2 goes as that of g_j g_k exp(-|j - k| T / CORRELATION_S) over all pairs, and its
    ratio to the sum of q is that by which the estimate's variance is larger than V (the sandwich
    variance of a regression; Newey and West, Econometrica 55, 1987).

    Parameters
    ----------
    sums : Array
        y, q, and the sums of y^2 and of q, (4,); changed.
    change : float
        c, kg.
    before, after : float
        V and V+, kg^2.
    step : float
        T, s.

    """
    if not 0.0 < after < before:
        return
    kept = math.exp(-step / CORRELATION_S)
    sums[0] = kept * sums[0] + change / math.sqrt(before) / math.sqrt(after)
    sums[1] = kept * kept * sums[1] + (1.0 - after / before) / after
    sums[2] += sums[0] * sums[0]
    sums[3] += sums[1]


def score_ratio(sums: Array) -> float:
    """Return by how much the payload's variance is larger than stated; 1 where nothing is seen."""
    return sums.item(2) / sums.item(3) if sums.item(3) > 0.0 else 1.0
