"""The misfit of a model: by how much the variance that it states is too small."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.filter import Filter
from flex_payload_estimator.estimators.rpe.likelihood import reduced_chi_square, SCORE
from flex_payload_estimator.estimators.rpe.prior import Prior, tolerances_off
from flex_payload_estimator.estimators.rpe.score import score_ratio


def variance_factor(f: Filter, prior: Prior) -> float:
    """
    Return D, by which the variance of a mode with free parts is multiplied, at least 1.

    The larger of the reduced chi-squares of the innovations and of the payload's score, times that
    of the parts' deviations (squared Birge ratios), each at least 1.
    """
    factor = max(1.0, reduced_chi_square(f.statistics))
    if f.mode.free_parts:
        # Before the first pass the payload moves because it is linearised elsewhere.
        if f.passes > 0:
            factor = max(factor, score_ratio(f.statistics[SCORE], f.age))
        factor *= max(1.0, tolerances_off(f.beta, f.beta_cov, prior.mean, prior.weights))
    return factor


def pooled_misfit(own: float, learnt_s: float, before: float, seen_s: float) -> float:
    """
    Return the reduced chi-square of a filter and of those before it, at least its own.

    A restart forgets state and parts, but the model stays as wrong as it was. Chi-squares of
    independent stretches add, as do their degrees of freedom, which go with the time in motion;
    so the reduced one of both is their mean.

    Parameters
    ----------
    own, learnt_s : float
        Of the filter, and the time in motion that it has learnt, s.
    before, seen_s : float
        Of those before it, over what it has not learnt, and the time in motion of both, s.

    """
    if before <= own or seen_s <= learnt_s:
        return own
    return (learnt_s * own + (seen_s - learnt_s) * before) / seen_s
