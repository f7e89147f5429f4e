"""The misfit of a model: by how much the variance that it states is too small."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.filter import Filter
from flex_payload_estimator.estimators.rpe.likelihood import reduced_chi_square, SCORE
from flex_payload_estimator.estimators.rpe.modes import ROUGH
from flex_payload_estimator.estimators.rpe.prior import Prior, tolerances_off
from flex_payload_estimator.estimators.rpe.score import score_ratio

# Where the published variance has to be multiplied by more than this, no mode's model holds.
SUSPECT_FACTOR = 3.0


def misfits(f: Filter, prior: Prior) -> tuple[float, float]:
    """
    Return the misfit that outlives a filter, and D, by which its variance is multiplied.

    The first is the reduced chi-square of the innovations times that of the parts' deviations
    (squared Birge ratios), each at least 1. For D the payload's score counts in place of the
    innovations where it says more: by how much this filter's own variance is too small.
    """
    square, off = max(1.0, reduced_chi_square(f.statistics)), max(1.0, parts_off(f, prior))
    # `coarse`, whose model error is larger than anything it has, moves by what it was led to
    # before.
    score = payload_score(f) if f.mode.name == ROUGH.name else 1.0
    return square * off, max(square, score) * off


def parts_off(f: Filter, prior: Prior) -> float:
    """Return the reduced chi-square of the parts' deviations, 1 as a mean over good arms."""
    if not f.mode.free_parts:
        return 1.0
    return tolerances_off(f.beta, f.beta_cov, prior.mean, prior.weights)


def disagreement(f: Filter, factor: float, other: Filter) -> float:
    """
    Return by how much more the variance of f, times a factor, is too small, at least 1.

    Where another model predicts better and finds another payload, neither is right. Two values of
    one quantity have the squared Birge ratio (m - m')^2 / (V + V').
    """
    return max(1.0, (f.mass - other.mass)**2 / (factor * f.variance + other.variance))


def no_model_holds(f: Filter, factor: float, prior: Prior) -> bool:
    """
    Tell whether an incumbent, whose variance is multiplied by a factor, is suspect.

    So it is where its parts are further off than those of good arms. Before its first pass free
    parts may be: they are linearised elsewhere.
    """
    return factor > SUSPECT_FACTOR or f.passes > 0 and parts_off(f, prior) > prior.most_off


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
