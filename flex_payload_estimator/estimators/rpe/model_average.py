"""The payload averaged over two models: with biases, a zero and lasting forces, and without."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.small_matrices import applied, inner, whitener
from flex_payload_estimator.estimators.rpe.time_update import FIRST_BIAS, MASS
from flex_payload_estimator.kalman.in_place import logarithms
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
import numpy as np


@compiled
def model_averaged(beta: Array, beta_cov: Array, std: Array) -> tuple[float, float]:
    """
    Return payload, kg, and its variance, kg^2, by Bayesian model averaging.

    The gauges' biases, and with free parts the zero of joint 2's angle and the constant
    disturbances, have a spike-and-slab prior (Mitchell and Beauchamp, J. Am. Stat. Assoc. 83,
    1988): with probability 1/2 all are zero. Their slabs are as wide as sensors drift and slip
    whatever the robot file says, the spike is an arm that does as it says. The posterior of that
    model is the filter's, given that they are zero, and its Bayes factor is the ratio of posterior
    to prior density there (Savage and Dickey), exact as they act linearly.

    Parameters
    ----------
    beta, beta_cov : Array
        (B,) and V, (B, B).
    std : Array
        Prior standard deviation of the biases, m/m, and of the zero, rad, (G + 1,), or of these
        and of the disturbances, (G + 5,). That of an exact model's zero is CERTAIN, which adds
        nothing.

    """
    mass, variance = beta[MASS], beta_cov[MASS, MASS]
    if std.size == 0:
        return mass, variance
    last = FIRST_BIAS + std.size
    white = whitener(beta_cov[FIRST_BIAS:last, FIRST_BIAS:last].copy())
    bias = applied(white, beta[FIRST_BIAS:last])
    cross = applied(white, beta_cov[FIRST_BIAS:last, MASS].copy())
    evidence = logarithms(white) + np.log(std).sum() - 0.5 * inner(bias, bias)
    if not np.isfinite(evidence):
        return mass, variance
    share = 1.0 / (1.0 + np.exp(-min(max(evidence, -30.0), 30.0)))
    off = inner(cross, bias)
    return (mass - share * off, max(variance - share * inner(cross, cross), 0.0)
            + share * (1.0 - share) * off * off)
