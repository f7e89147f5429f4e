"""
The measurement update of the augmented Kalman filter in Friedland's form, on plain arrays.

With y = C x + offset, gauges' gains, biases and an angle's zero among beta, and
Psi = H s + dh/dbeta:

    Sigma = H P H' + R + Psi V Psi',     beta <- beta + V Psi' Sigma^-1 e,
    V <- V - V Psi' Sigma^-1 Psi V,      K = P H' (H P H' + R)^-1,      s <- s - K Psi.

See time_update.py for x, P, s, beta and V.
"""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.small_matrices import (
    applied,
    inner,
    product,
    squared,
    whitener,
)
from flex_payload_estimator.estimators.rpe.time_update import FIRST_BIAS, MASS
from flex_payload_estimator.kalman.in_place import (
    add,
    add_diagonal,
    add_matrix,
    logarithms,
    put,
    put_mean,
    scaled,
)
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
import numpy as np

# P's diagonal grows by this share a sample, more than rounding takes from it: a memory of 1e12
# samples.
JITTER = 1e-12


@compiled
def _expected(x: Array, sensitivity: Array, reference: Array, offset: Array, output: Array,
              gains: int) -> tuple[Array, Array, Array]:
    """Return the outputs expected at the reference, (m,), H, (m, n), and Psi, (m, B)."""
    size, gauges, slope = reference.size, len(output) - 2, output
    expected = applied(output, x)
    add(expected, 1.0, offset)
    unscaled = expected.copy()
    if gains > 0:
        slope = output.copy()
        for g in range(gauges):
            gain = reference[size - gains + g]
            expected[2 + g] += gain * unscaled[2 + g]
            add(slope[2 + g], gain, output[2 + g])
    psi = product(slope, sensitivity)
    for g in range(gauges):
        psi[2 + g, FIRST_BIAS + g] += 1.0
        if gains > 0:
            psi[2 + g, size - gains + g] += unscaled[2 + g]
    add(expected[2:], 1.0, reference[FIRST_BIAS:FIRST_BIAS + gauges])
    # The state has joint 2's true angle, at which the schedule is taken.
    expected[1] += reference[FIRST_BIAS + gauges]
    psi[1, FIRST_BIAS + gauges] += 1.0
    return expected, slope, psi


@compiled
def _covariances(cov: Array, beta_cov: Array, slope: Array, psi: Array, noise: Array
                 ) -> tuple[Array, Array, Array, Array]:
    """Return P H', H P H', V Psi' and Sigma."""
    cross_cov, beta_cross_cov = squared(cov, slope), squared(beta_cov, psi)
    output_cov, total = product(slope, cross_cov), product(psi, beta_cross_cov)
    add_matrix(total, 1.0, output_cov)
    add_diagonal(total, noise)
    return cross_cov, output_cov, beta_cross_cov, total


@compiled
def _gain(cross_cov: Array, output_cov: Array, noise: Array) -> Array:
    """Return K, (n, m), of P H', H P H' and the noise's variances."""
    total = output_cov.copy()
    add_diagonal(total, noise)
    white = whitener(total)
    return product(squared(cross_cov, white), white)


@compiled
def _reduce_covariance(cov: Array, gain: Array, slope: Array, noise: Array) -> None:
    """Update P in Joseph's form, (K H - I) P (K H - I)' + K R K'."""
    left = product(gain, slope)
    add_diagonal(left, np.full(len(left), -1.0))
    after = squared(product(left, cov), left)
    add_matrix(after, 1.0, squared(scaled(gain, noise), gain))
    put_mean(cov, after, 1.0 + JITTER)


@compiled
def _widened(total: Array, noise: Array, more: Array) -> Array:
    """Add variances, (m,), to Sigma in place; return the noise with them."""
    add_diagonal(total, more)
    return noise + more


@compiled
def _learn(x: Array, cov: Array, sensitivity: Array, beta: Array, beta_cov: Array,
           reference: Array, fixed: bool, at_reference: Array, slope: Array, psi: Array,
           noise: Array, gain: Array, beta_gain: Array, scores: Array, payload_max: float
           ) -> float:
    """
    Update x, P, s, beta and V; return the payload's change, kg, before it is limited.

    NaN, and nothing is changed, where the state is lost.

    `at_reference` is the innovation at the reference parameters, (m,); `scores` that at beta,
    whitened by L^-1 with L L' = Sigma and the gate, (m,); `gain` is K, (n, m); `beta_gain` is
    V Psi' L'^-1, (B, m).
    """
    moved, after, reduced = applied(gain, at_reference), beta.copy(), beta_cov.copy()
    add(after, 1.0, applied(beta_gain, scores))
    change = after[MASS] - beta[MASS]
    after[MASS] = min(max(after[MASS], 0.0), payload_max)
    add_matrix(reduced, -1.0, squared(beta_gain, beta_gain))
    # Negative only where P or V is no covariance, or rounding took all digits.
    variance = reduced[MASS, MASS]
    if variance < 0.0 or not np.isfinite(inner(moved, moved) + variance):
        return np.nan
    add_matrix(sensitivity, -1.0, product(gain, psi))
    add(x, 1.0, moved)
    if not fixed:
        add(x, 1.0, applied(sensitivity, after - reference))
    # Only now: the reference may be beta itself.
    put(beta, after)
    put_mean(beta_cov, reduced, 1.0)
    _reduce_covariance(cov, gain, slope, noise)
    return change


@compiled
def correct(x: Array, cov: Array, sensitivity: Array, beta: Array, beta_cov: Array,
            reference: Array, fixed: bool, measured: Array, offset: Array, output: Array,
            noise: Array, gains: int, gate: float, payload_max: float
            ) -> tuple[Array, Array, Array, float, float]:
    """
    Learn from a measurement: x, P, s, beta and V change in place.

    Parameters
    ----------
    x, cov, sensitivity, beta, beta_cov : Array
        x (n,), P (n, n), s (n, B), beta (B,) and V (B, B).
    reference, fixed : Array, bool
        Parameters about which everything is linearised, (B,), and whether they are fixed; else
        they are beta. x is the state for these; for beta it is x + s (beta - reference).
    measured, offset, output : Array
        y, and what it is beyond C x without gains and biases, (m,); C, (m, n).
    noise, gains : Array, int
        Variance of each channel's noise, (m,); number of gauge gains, the last columns of beta.
    gate, payload_max : float
        Largest e' Sigma^-1 e, beyond which the sample's noise counts as so large that it is the
        gate or less: one absurd sample moves nothing, many are believed (Huber). Payload, kg.

    Returns
    -------
    innovation, variances, scores : Array
        e, the diagonal of Sigma, and L^-1 e with L L' = Sigma; all before the gate, (m,).
    log_det, change : float
        ln |Sigma| with the gate, NaN where the state is lost and nothing is learnt; by how much
        the payload would have changed without its limits, kg.

    """
    expected, slope, psi = _expected(x, sensitivity, reference, offset, output, gains)
    at_reference = measured - expected
    innovation = at_reference - applied(psi, beta - reference) if fixed else at_reference
    cross_cov, output_cov, beta_cross_cov, total = _covariances(cov, beta_cov, slope, psi, noise)
    white, variances = whitener(total), np.diag(total).copy()
    scores = applied(white, innovation)
    chi_square = inner(scores, scores)
    if chi_square > gate:
        noise = _widened(total, noise, (chi_square / gate - 1.0) * variances)
        white = whitener(total)
    change = _learn(x, cov, sensitivity, beta, beta_cov, reference, fixed, at_reference, slope,
                    psi, noise, _gain(cross_cov, output_cov, noise),
                    squared(beta_cross_cov, white), applied(white, innovation), payload_max)
    log_det = np.nan if np.isnan(change) else -2.0 * logarithms(white)
    return innovation, variances, scores, log_det, change
