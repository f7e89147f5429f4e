"""
The arithmetic of one recursive-prediction-error step, on plain arrays.

The same code runs with and without Numba; only two-dimensional products.
Columns of the sensitivity: dx/dm since the start, dx/dm since the start of either of two
staggered windows (what a payload change then would have done), dx/d(part parameter).
"""

from __future__ import annotations

import math

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED, compiled
import numpy as np
from scipy.linalg.lapack import dgetrf, dgetri

MASS_COLUMNS = 3


def _inverse_by_lapack(matrix: Array) -> tuple[Array, float]:
    factors, pivots, _ = dgetrf(matrix)
    return dgetri(factors, pivots)[0], abs(float(factors.diagonal().prod()))


@compiled
def _inverse_by_loops(matrix: Array) -> tuple[Array, float]:
    """Return inverse and determinant by Cholesky's factors; both NaN where there are none."""
    size, square = len(matrix), 1.0
    lower, inverse = np.zeros_like(matrix), np.zeros_like(matrix)
    for i in range(size):
        for j in range(i + 1):
            rest = matrix[i, j]
            for k in range(j):
                rest -= lower[i, k] * lower[j, k]
            if j < i:
                lower[i, j] = rest / lower[j, j]
            elif rest > 0.0:
                lower[i, i] = np.sqrt(rest)
                square *= rest
            else:
                return np.full_like(matrix, np.nan), np.nan
    for c in range(size):
        # Forwards by L, then backwards by L'; what stands above row c stays zero on the way.
        inverse[c, c] = 1.0
        for i in range(c, size):
            for k in range(c, i):
                inverse[i, c] -= lower[i, k] * inverse[k, c]
            inverse[i, c] /= lower[i, i]
        for i in range(size - 1, -1, -1):
            for k in range(i + 1, size):
                inverse[i, c] -= lower[k, i] * inverse[k, c]
            inverse[i, c] /= lower[i, i]
    return inverse, square


# Inverse and determinant of a covariance; LAPACK's calls are quicker only beside plain Python.
inverse_and_size = _inverse_by_loops if COMPILED else _inverse_by_lapack


@compiled
def predict(x: Array, cov: Array, sens: Array, order: Array, value: Array, slopes: Array,
            parts: Array, away: float, command: Array, torque: Array, floor: Array
            ) -> tuple[Array, Array, Array]:
    """
    Return state, covariance and sensitivity one sample later, delta form.

    x+ = x + T (A x + B u),  s+ = s + T (J s + dA/dm x + dB/dm u),  P+ = (I + T J) P (I + T J)'
    + Q, with J the Jacobian of A x + B u over x (theta_2 inside A and B included).

    Parameters
    ----------
    x, cov, sens : Array
        (n,), (n, n) given the payload, (n, 3 + p).
    order : Array
        0, 1, … of the cosine series, (K,).
    value, slopes : Array
        See PayloadSlice.
    parts : Array
        Derivatives over the part parameters, (K', p W), or (1, 0).
    away : float
        m - slice payload, kg.
    command : Array
        u held over the sample, (2,).
    torque : Array
        Standard deviation of the command's disturbance, in its unit, (2,).
    floor : Array
        Covariance added to the state, (n, n), or (0, 0) for none.

    """
    n = x.size
    width = n * (n + 2)
    angles = x[1] * order
    wave = np.cos(angles)
    over = wave @ slopes
    bend = away * over[width:]
    over_m = over[:width] + bend
    increment = (wave @ value + away * (over_m - 0.5 * bend)).reshape(n, n + 2)
    over_angle = (-order * np.sin(angles)) @ value
    drive = np.concatenate((x, command))
    jacobian = increment[:, :n].copy()
    jacobian[:, 1] += over_angle.reshape(n, n + 2) @ drive
    sens = sens + jacobian @ sens
    sens[:, :MASS_COLUMNS] += (over_m.reshape(n, n + 2) @ drive).reshape(n, 1)
    if parts.shape[1] > 0:
        coarse = ((wave[:parts.shape[0]] @ parts).reshape(-1, n + 2) @ drive).reshape(-1, n)
        sens[:, MASS_COLUMNS:MASS_COLUMNS + coarse.shape[0]] += coarse.T
    noise = increment[:, n:] * torque
    half = jacobian @ cov
    cov = cov + half + half.T + half @ jacobian.T + noise @ noise.T
    if floor.size > 0:
        cov += floor
    return x + increment @ drive, cov, sens


@compiled
def weigh(x: Array, cov: Array, sens: Array, variance: float, lean: Array, offset: Array,
          output: Array, gains: Array, noise: Array, halves: Array, limit: float
          ) -> tuple[Array, Array, Array, Array, Array, Array, Array, Array, Array, float,
                     float]:
    """
    Return what a measurement to come will be worth: all of `correct` that does not need it.

    Joseph form. Parameters as in `correct`.

    Returns
    -------
    tuple
        The measurement expected, (m,); P, sensitivity and lean after it; the gain (n, m); S^-1
        (m, m) for a known payload; S^-1 psi (m, 3 + p); psi'S^-1 psi of the first columns, (3,);
        the innovation's standard deviation per channel, payload included, (m,); the payload's
        variance after it; log det S, payload included. Where the state is lost, log det S is
        NaN, and nothing else counts.

    """
    expected, projected = output @ x + offset, cov @ output.T
    total = output @ projected + np.diag(noise)
    variances = np.diag(total).copy()
    # A comparison with NaN is false.
    if not (variances.sum() < limit and variances.min() > 0.0):
        return (expected, cov, sens, lean, projected, total, projected, variances, variances,
                variance, np.nan)
    inverse, size = inverse_and_size(total)
    gain = projected @ inverse
    psi = output @ sens
    if lean.size > 0:
        psi[:, MASS_COLUMNS:] += gains * expected.reshape(-1, 1)
    weighted = inverse @ psi
    known = (psi[:, :MASS_COLUMNS] * weighted[:, :MASS_COLUMNS]).sum(axis=0)
    spread = 1.0 + variance * known[0]
    pull = variance / spread
    deviation = np.sqrt(variances + variance * psi[:, 0]**2)
    if lean.size > 0:
        cross = (psi[:, MASS_COLUMNS:] * weighted[:, :1]).sum(axis=0)
        lean = lean - pull * (cross + known[0] * lean)
    keep = np.eye(len(cov)) - gain @ output
    cov = keep @ cov @ keep.T + (gain * noise) @ gain.T
    return (expected, halves * (cov + cov.T), sens - gain @ psi, lean, gain, inverse, weighted,
            known, deviation, pull, np.log(spread * size))


@compiled
def learn(x: Array, mass: float, sums: Array, measured: Array, expected: Array, told: Array,
          heaviest: float, sens: Array, gain: Array, inverse: Array, weighted: Array,
          known: Array, deviation: Array, pull: float
          ) -> tuple[Array, float, Array, Array, float]:
    """
    Return state, payload, sums, reading and misfit after a measurement that was weighed.

    The state moves with the payload by its sensitivity, so that the whole is the augmented
    Kalman filter in factored form (Friedland, IEEE Trans. Autom. Control 14, 1969). Parameters
    and results as in `correct` and `weigh`.
    """
    innovation = measured - expected
    score = innovation @ weighted
    after = min(max(mass + pull * score[0], 0.0), heaviest)
    misfit = innovation @ (inverse @ innovation) - pull * score[0] * score[0]
    gathered, reading = sums.copy(), np.empty((2, told.size))
    gathered[0] += score[:MASS_COLUMNS]
    gathered[1] += known
    reading[0], reading[1] = innovation * told, deviation * told
    return x + gain @ innovation + sens[:, 0] * (after - mass), after, gathered, reading, misfit


@compiled
def correct(x: Array, cov: Array, sens: Array, mass: float, variance: float, lean: Array,
            sums: Array, measured: Array, offset: Array, output: Array, gains: Array,
            noise: Array, told: Array, halves: Array, limit: float, heaviest: float
            ) -> tuple[Array, Array, Array, float, float, Array, Array, Array, float, float]:
    """
    Return the hypothesis after a measurement, and its statistics.

    Parameters
    ----------
    x, cov, sens : Array
        See predict.
    mass, variance : float
        kg, and kg^2 for white innovations and exact parts.
    lean : Array
        d(m - estimate)/d(part parameter), (p,).
    sums : Array
        psi'S^-1 e and psi'S^-1 psi of the first columns so far, S for a known payload, (2, 3).
    measured, offset : Array
        y, and what y is beyond C x, (m,).
    output : Array
        C, (m, n).
    gains : Array
        Where a strain gain acts among the part parameters, (m, p).
    noise : Array
        Variance of each channel, (m,).
    told : Array
        Unit of each channel, (m,).
    halves : Array
        What P + P' is multiplied with: 1/2, a little more on the diagonal, (n, n).
    limit : float
        Sum of the innovations' variances beyond which the state is lost.
    heaviest : float
        The payload stays in [0, heaviest], kg.

    Returns
    -------
    tuple
        x, cov, sens, mass, variance, lean, sums; the innovation e = y - C x - offset and its
        standard deviation per channel, times their units, (2, m); e'S^-1 e and log det S with S
        the innovation's covariance, payload included. Where the state is lost, log det S is
        NaN, and nothing else counts.

    """
    expected, cov, sens, lean, gain, inverse, weighted, known, deviation, pull, log_det = weigh(
        x, cov, sens, variance, lean, offset, output, gains, noise, halves, limit)
    if math.isnan(log_det):
        return x, cov, sens, mass, variance, lean, sums, sums, np.nan, log_det
    x, mass, sums, reading, misfit = learn(
        x, mass, sums, measured, expected, told, heaviest, sens, gain, inverse, weighted, known,
        deviation, pull)
    return x, cov, sens, mass, pull, lean, sums, reading, misfit, log_det


@compiled
def step(x: Array, cov: Array, sens: Array, order: Array, value: Array, slopes: Array,
         parts: Array, away: float, command: Array, torque: Array, floor: Array, mass: float,
         variance: float, lean: Array, sums: Array, measured: Array, offset: Array,
         output: Array, gains: Array, noise: Array, told: Array, halves: Array, limit: float,
         heaviest: float
         ) -> tuple[Array, Array, Array, float, float, Array, Array, Array, float, float]:
    """Return what `correct` does after `predict`: one call where nothing is between them."""
    x, cov, sens = predict(x, cov, sens, order, value, slopes, parts, away, command, torque,
                           floor)
    return correct(x, cov, sens, mass, variance, lean, sums, measured, offset, output, gains,
                   noise, told, halves, limit, heaviest)
