"""The payload averaged over two models: with biases and forces that last, and with none."""

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
    Return payload, kg, and its variance where what lasts may as well be none.

    The gauges' biases, with parts forces at the tip and in the drives as well. Their prior is a
    spike and slab (Mitchell and Beauchamp, J. Am. Stat. Assoc. 83, 1988): half of it says none.
    That model is the posterior given that they vanish, and the evidence for it the ratio of
    posterior to prior density there (Savage and Dickey), exact as they act linearly. The mean and
    variance are those of Bayesian model averaging.

    Parameters
    ----------
    beta, beta_cov : Array
        (B,) and V, (B, B).
    std : Array
        Prior standard deviation of the biases, m/m, (G,), or of these and the forces, (G + 4,).

    """
    mass, variance = beta[MASS], beta_cov[MASS, MASS]
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
