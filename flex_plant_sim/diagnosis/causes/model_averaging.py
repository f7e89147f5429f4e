"""How far sizes and parts may be from those of the best set, over all sets that were fitted."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.fit import Fit, NOTABLE_EXCESS
from flex_plant_sim.diagnosis.causes.hypothesis import CauseSet, Hypothesis
from flex_plant_sim.diagnosis.causes.posterior import Posterior
import numpy as np

# Records that windows are drawn for: shares are known to one in a hundred.
BOOTSTRAP_DRAWS = 2000


def set_weights(posterior: Posterior) -> Array:
    """
    Return how much each set counts for the sizes of what is in it, (S,), one in sum.

    Its probability; where errors are larger than any model's, so that they go with the motion,
    the mean of what that would be in records of windows drawn from these with replacement. Nats
    between sets then hang on the record by far more than their number tells. Bagged posteriors:
    J. H. Huggins and J. W. Miller, Bayesian Analysis 18 (2023).
    """
    with np.errstate(divide='ignore'):
        logarithm = np.log(posterior.probability)
    found = logarithm[None]
    nats = np.array([fit.window_log_likelihoods for fit in posterior.fits])
    count = nats.shape[1]
    if count and np.any(posterior.best.error_scale > NOTABLE_EXCESS):
        drawn = np.random.default_rng(0).multinomial(count, np.full(count, 1.0 / count), BOOTSTRAP_DRAWS)
        found = logarithm + (drawn - 1) @ nats.T
    weight = np.exp(found - found.max(axis=1, keepdims=True))
    return np.asarray(np.mean(weight / weight.sum(axis=1, keepdims=True), axis=0))


def averaged_size_deviations(posterior: Posterior, hypothesis: Hypothesis) -> Array:
    """
    Return root mean square distances from a cause's values in the best set, (k,).

    Over the sets that have the cause, within each as its own posterior says.
    """
    rows = []
    for fit, share in zip(posterior.fits, set_weights(posterior)):
        if hypothesis in fit.hypotheses:
            places = value_indices(fit, hypothesis)
            rows.append((share, fit.values[places], np.diagonal(fit.covariance)[places]))
    return _rms(rows, posterior.best.values[value_indices(posterior.best, hypothesis)])


def averaged_part_deviations(posterior: Posterior) -> Array:
    """Return the same of all parts, (p,), over all sets."""
    rows = [(share, fit.deviations, np.diagonal(fit.covariance)[len(fit.values):])
            for fit, share in zip(posterior.fits, set_weights(posterior))]
    return _rms(rows, posterior.best.deviations)


def value_indices(fit: Fit, hypothesis: Hypothesis) -> Array:
    """Return where a cause's values are among a fit's, (k,)."""
    pieces = CauseSet(fit.hypotheses, 1.0).split(np.arange(1.0 * len(fit.values)))
    return pieces[fit.hypotheses.index(hypothesis)].astype(int)


def _rms(rows: list[tuple[float, Array, Array]], values: Array) -> Array:
    share, mean, variance = (np.array(part) for part in zip(*rows))
    return np.sqrt(share @ (variance + (mean - values)**2) / share.sum())
