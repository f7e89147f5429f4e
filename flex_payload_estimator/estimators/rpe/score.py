"""The payload's score: whether the estimate moves by as much as its variance says."""

from __future__ import annotations

import math

from flex_payload_estimator.estimators.rpe.likelihood import MEMORY_S
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled

# Memory of the score's sum, s, that of the other statistics: of errors that last longer, as much
# counts.
CORRELATION_S = MEMORY_S
# Time in motion, s, for which the stated variance counts: two memories, as in one or two chance
# makes almost anything of the ratio (benchmarks/score_prior.py, seeds 642500 and 646500).
PRIOR_S = 1.0
# Error of a payload, as a share of the moving mass, over the mean square of the angles by which
# bending turns the links (benchmarks/bending.py, seeds 719010 to 719015).
BENDING_SHARE = 0.1


@compiled
def update_score(sums: Array, change: float, before: float, after: float, turned: float,
                 step: float) -> None:
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
        y, q, and the sums of y^2, q, q times `turned` and q times its square, (6,); changed.
    change : float
        c, kg.
    before, after : float
        V and V+, kg^2.
    turned : float
        Mean square of the angles by which bending turns the ends of the links, rad^2.
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
    sums[4] += sums[1] * turned
    sums[5] += sums[1] * turned * turned


def score_ratio(sums: Array, learnt_s: float) -> float:
    """
    Return by how much the payload's variance is larger than stated.

    Each memory is a degree of freedom; the prior is that it is as stated, with PRIOR_S.

    Parameters
    ----------
    sums : Array
        See `update_score`.
    learnt_s : float
        Time in motion that the filter has learnt, s.

    """
    if not sums.item(3) > 0.0:
        return 1.0
    return (PRIOR_S + learnt_s * sums.item(2) / sums.item(3)) / (PRIOR_S + learnt_s)


def bending_error(sums: Array) -> float:
    """
    Return by which share of the moving mass bending makes a payload wrong.

    The forces are right to first order in the angles by which bending turns the links' ends. What
    is left out is smaller by their square, and the same whenever the arm moves alike, so that it
    stays however long the payload is weighed; free parts let the payload stand for all that moves.
    The square is averaged over what bends and was learnt from.
    """
    return BENDING_SHARE * sums.item(5) / sums.item(4) if sums.item(4) > 0.0 else 0.0
