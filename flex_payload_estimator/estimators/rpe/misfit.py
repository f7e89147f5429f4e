"""The misfit of a model: by how much the variance that it states is too small."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.filter import Filter
from flex_payload_estimator.estimators.rpe.likelihood import reduced_chi_square, SCORE
from flex_payload_estimator.estimators.rpe.modes import ROUGH
from flex_payload_estimator.estimators.rpe.prior import Prior, tolerances_off
from flex_payload_estimator.estimators.rpe.score import score_ratio


def misfits(f: Filter, prior: Prior) -> tuple[float, float]:
    """
    Return the misfit that outlives a filter, and D, by which its variance is multiplied.

    The first is the reduced chi-square of the innovations times that of the parts' deviations
    (squared Birge ratios), each at least 1. For D the payload's score counts in place of the
    innovations where it says more: by how much this filter's own variance is too small.
    """
    square, off = max(1.0, reduced_chi_square(f.statistics)), 1.0
    if f.mode.free_parts:
        off = max(1.0, tolerances_off(f.beta, f.beta_cov, prior.mean, prior.weights))
    # `coarse`, whose model error is larger than anything it has, moves by what it was led to
    # before.
    score = payload_score(f) if f.mode.name == ROUGH.name else 1.0
    return square * off, max(square, score) * off


def payload_score(f: Filter) -> float:
    """
    Return the score ratio.

    Before the first pass of free parts it says nothing: the payload moves because it is linearised
    elsewhere.
    """
    if f.mode.free_parts and f.passes == 0:
        return 1.0
    return score_ratio(f.statistics[SCORE], f.age)


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
