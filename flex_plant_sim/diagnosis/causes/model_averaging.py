"""
Uncertainty of sizes and parts, averaged over all sets of causes that were fitted.

The verdict states the estimates of the best set with the deviations computed here.
"""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.hypothesis import CauseSet, Hypothesis
from flex_plant_sim.diagnosis.causes.posterior import Posterior
import numpy as np

# Bootstrap records; weights are then known to 0.01.
BOOTSTRAP_DRAWS = 2000


def set_weights(posterior: Posterior) -> Array:
    """
    Return the weight of each set in averages of sizes and parts, (S,), with sum 1.

    It is the set's probability. Where errors are larger than any model's, they go with the motion,
    and the differences of evidence are much less certain than their values say. Then it is the
    bagged posterior: the mean probability over records of windows drawn with replacement. J. H.
    Huggins and J. W. Miller, Bayesian Analysis 18 (2023).
    """
    with np.errstate(divide='ignore'):
        logarithm = np.log(posterior.probability)
    scores = logarithm[None]
    by_window = np.array([fit.window_log_likelihoods for fit in posterior.fits])
    count = by_window.shape[1]
    if count and posterior.best.large_errors.any():
        drawn = np.random.default_rng(0).multinomial(
            count, np.full(count, 1.0 / count), BOOTSTRAP_DRAWS)
        scores = logarithm + (drawn - 1) @ by_window.T
    weight = np.exp(scores - scores.max(axis=1, keepdims=True))
    return np.asarray(np.mean(weight / weight.sum(axis=1, keepdims=True), axis=0))


def averaged_size_deviations(posterior: Posterior, hypothesis: Hypothesis) -> Array:
    """
    Return root mean square deviations from a cause's values in the best set, (k,).

    Over the sets that have the cause, with whatever discrete values, and with the posterior
    variance within each.
    """
    rows = []
    for fit, weight in zip(posterior.fits, set_weights(posterior)):
        for own in (h for h in fit.hypotheses if h.label == hypothesis.label):
            indices = value_indices(fit, own)
            rows.append((weight, fit.values[indices], np.diagonal(fit.covariance)[indices]))
    return _rms(rows, posterior.best.values[value_indices(posterior.best, hypothesis)])


def value_probabilities(posterior: Posterior, hypothesis: Hypothesis, index: int
                        ) -> dict[float, float]:
    """
    Return the probability of each value of a cause's parameter that is discrete.

    Over the sets that have the cause; they sum to 1.
    """
    found: dict[float, float] = {}
    for fit, weight in zip(posterior.fits, set_weights(posterior)):
        for own in (h for h in fit.hypotheses if h.label == hypothesis.label):
            value = own.parameters[index].low
            found[value] = found.get(value, 0.0) + float(weight)
    total = sum(found.values())
    return {value: weight / total for value, weight in found.items()}


def averaged_part_deviations(posterior: Posterior) -> Array:
    """Return root mean square deviations from the parts of the best set, (p,), over all sets."""
    rows = [(weight, fit.deviations, np.diagonal(fit.covariance)[len(fit.values):])
            for fit, weight in zip(posterior.fits, set_weights(posterior))]
    return _rms(rows, posterior.best.deviations)


def value_indices(fit: Fit, hypothesis: Hypothesis) -> Array:
    """Return the indices of a cause's values among a fit's, (k,)."""
    indices = CauseSet(fit.hypotheses, 1.0).split(np.arange(1.0 * len(fit.values)))
    return indices[fit.hypotheses.index(hypothesis)].astype(int)


def _rms(rows: list[tuple[float, Array, Array]], values: Array) -> Array:
    """Return root mean square deviations from values (k,) over weights, means and variances."""
    weight, mean, variance = (np.array(column) for column in zip(*rows))
    return np.sqrt(weight @ (variance + (mean - values)**2) / weight.sum())
