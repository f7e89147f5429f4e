"""The payload averaged over which part of the arm, if any, is far off its tolerance."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.time_update import MASS
from flex_plant_sim.arm.parts import FAR_PART_FACTOR
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
import numpy as np

# Prior odds that one part is far off, as of any cause in the diagnosis (PROBABILITY_ANY_CAUSE).
# With a ninth of them, and with half and three times FAR_PART_FACTOR, errors are the same within a
# tenth (docs/estimator_method.md).
FAR_ODDS = 1.0


@compiled
def far_part_averaged(beta: Array, beta_cov: Array, off: Array, std: Array, scale: Array,
                      scale_variance: float) -> tuple[float, float]:
    """
    Return by how much the payload moves, kg, and its further variance, kg^2.

    In the filter's prior each part is within its tolerance, so that one that is far off moves all
    others: a drive of half its gain made every mass lighter by a seventh, as no output shows the
    arm's scale. With a heavy tail it does not. Either all parts are within their tolerances, or
    one of them, any, has k = FAR_PART_FACTOR of them as standard deviation. The posterior of each
    hypothesis follows from the filter's: the factor N(0, k^2 t^2) / N(0, t^2) on one parameter
    changes mean, variance and evidence in closed form (a spike and slab, as in model_average.py).

    Parameters
    ----------
    beta, beta_cov : Array
        (B,) and V, (B, B), without the variance of the arm's scale.
    off, std, scale : Array
        Of the last P parameters, which have a tolerance: how far each is off, its tolerance t, and
        whether it grows with the arm's scale (Prior), (P,).
    scale_variance : float
        Relative variance of the arm's scale.

    """
    first = beta.size - off.size
    variance = np.diag(beta_cov)[first:] + scale_variance * scale
    covariance = beta_cov[MASS, first:] + scale_variance * beta[MASS] * scale
    # The information on a part that the prior gives more if the part is within its tolerance.
    given = (1.0 - FAR_PART_FACTOR**-2) / std**2
    left = np.maximum(1.0 - given * variance, FAR_PART_FACTOR**-2)
    log_odds = 0.5 * (given * off**2 / left - np.log(left)) \
        + np.log(FAR_ODDS / off.size / FAR_PART_FACTOR)
    largest = max(0.0, log_odds.max())
    odds = np.exp(log_odds - largest)
    probability = odds / (np.exp(-largest) + odds.sum())
    shift = covariance * given * off / left
    mean = (probability * shift).sum()
    return mean, (probability * (covariance**2 * given / left + shift**2)).sum() - mean**2
