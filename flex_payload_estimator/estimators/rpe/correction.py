"""What a measurement tells of state, payload and parts, on plain arrays; see kernel.py."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.kernel import FIRST_BIAS, MASS
from flex_payload_estimator.estimators.rpe.products import (
    applied,
    inner,
    product,
    squared,
    whitener,
)
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

# P's diagonal grows by this share a sample, above what rounding takes: a memory of 1e12 samples.
JITTER = 1e-12


@compiled
def _seen(x: Array, sens: Array, anchor: Array, offset: Array, output: Array, gains: int
          ) -> tuple[Array, Array, Array]:
    """Return what is expected of the outputs at the anchor, its slopes over x and over beta."""
    size, gauges, seen = anchor.size, len(output) - 2, output
    expected = applied(output, x)
    add(expected, 1.0, offset)
    base = expected.copy()
    if gains > 0:
        seen = output.copy()
        for g in range(gauges):
            more = anchor[size - gains + g]
            expected[2 + g] += more * base[2 + g]
            add(seen[2 + g], more, output[2 + g])
    psi = product(seen, sens)
    for g in range(gauges):
        psi[2 + g, FIRST_BIAS + g] += 1.0
        if gains > 0:
            psi[2 + g, size - gains + g] += base[2 + g]
    add(expected[2:], 1.0, anchor[FIRST_BIAS:FIRST_BIAS + gauges])
    return expected, seen, psi


@compiled
def _gain(projected: Array, known: Array, noise: Array) -> Array:
    """Return the gain for known parameters, (n, m), of P C', C P C' and the noise's variances."""
    total = known.copy()
    add_diagonal(total, noise)
    inverse = whitener(total)
    return product(squared(projected, inverse), inverse)


@compiled
def _shorten(cov: Array, gain: Array, seen: Array, noise: Array) -> None:
    """Make P what it is after a measurement, in Joseph's form."""
    lost = product(gain, seen)
    add_diagonal(lost, np.full(len(lost), -1.0))
    after = squared(product(lost, cov), lost)
    add_matrix(after, 1.0, squared(scaled(gain, noise), gain))
    put_mean(cov, after, 1.0 + JITTER)


@compiled
def _widened(total: Array, noise: Array, more: Array) -> Array:
    """Return the noise's variances with so much more, which Sigma has as well then."""
    add_diagonal(total, more)
    return noise + more


@compiled
def _learn(x: Array, cov: Array, sens: Array, beta: Array, spread: Array, anchor: Array,
           held: bool, alone: Array, seen: Array, psi: Array, noise: Array, gain: Array,
           learnt: Array, scores: Array, heaviest: float) -> bool:
    """
    Learn x, P, s, beta and V; tell whether the state is lost, and nothing is learnt, instead.

    `alone` is the innovation at the anchor, `scores` that at beta, whitened, (m,) each; `gain` is
    that for known beta, (n, m), and `learnt` is V psi' L'^-1, (B, m).
    """
    moved, after, less = applied(gain, alone), beta.copy(), spread.copy()
    add(after, 1.0, applied(learnt, scores))
    after[MASS] = min(max(after[MASS], 0.0), heaviest)
    add_matrix(less, -1.0, squared(learnt, learnt))
    # What is left is negative only where P or V is no covariance, or rounding took all digits.
    left = less[MASS, MASS]
    if left < 0.0 or not np.isfinite(inner(moved, moved) + left):
        return True
    add_matrix(sens, -1.0, product(gain, psi))
    add(x, 1.0, moved)
    if not held:
        add(x, 1.0, applied(sens, after - anchor))
    # Now, for the anchor may be beta itself.
    put(beta, after)
    put_mean(spread, less, 1.0)
    _shorten(cov, gain, seen, noise)
    return False


@compiled
def correct(x: Array, cov: Array, sens: Array, beta: Array, spread: Array, anchor: Array,
            held: bool, measured: Array, offset: Array, output: Array, noise: Array, gains: int,
            gate: float, heaviest: float
            ) -> tuple[Array, Array, Array, float]:
    """
    Learn from a measurement, x, P, s, beta and V, and return what it says of the model.

    That is the innovation e; the variances of its channels; L^-1 e with L L' = Sigma before the
    gate, (m,); ln |Sigma| as it was used, NaN where the state is lost: then nothing is learnt.

    Parameters
    ----------
    x, cov, sens, beta, spread : Array
        (n,), (n, n), (n, B), (B,) and V (B, B).
    anchor, held : Array, bool
        Parameters that all is linearised about, (B,), for which x is the state; it is x + s (beta
        - anchor) for beta. Where it is not held, the anchor follows beta, and x is taken there.
    measured, offset, output : Array
        y, and what y is beyond C x without gains and biases, (m,); C, (m, n).
    noise, gains : Array, int
        Variance of each channel, (m,); gauges whose gain is among beta: the last of its columns.
    gate : float
        Where e' Sigma^-1 e is beyond, the noise counts as large as makes it the gate: one
        absurd sample moves nothing, and many in a row are believed (Huber's influence).
    heaviest : float
        The payload stays in [0, heaviest], kg.

    """
    expected, seen, psi = _seen(x, sens, anchor, offset, output, gains)
    alone = measured - expected
    innovation = alone - applied(psi, beta - anchor) if held else alone
    projected, learnt = squared(cov, seen), squared(spread, psi)
    known, total = product(seen, projected), product(psi, learnt)
    add_matrix(total, 1.0, known)
    add_diagonal(total, noise)
    white, variances = whitener(total), np.diag(total).copy()
    scores = applied(white, innovation)
    misfit = inner(scores, scores)
    if misfit > gate:
        noise = _widened(total, noise, (misfit / gate - 1.0) * variances)
        white = whitener(total)
    lost = _learn(x, cov, sens, beta, spread, anchor, held, alone, seen, psi, noise,
                  _gain(projected, known, noise), squared(learnt, white),
                  applied(white, innovation), heaviest)
    return innovation, variances, scores, np.nan if lost else -2.0 * logarithms(white)
