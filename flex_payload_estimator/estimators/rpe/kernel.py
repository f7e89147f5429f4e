"""
The arithmetic of one step of the joint posterior of state, payload and parts, on plain arrays.

Friedland's factored form of the augmented Kalman filter (IEEE Trans. Autom. Control 14, 1969):
P is the state's covariance for known parameters beta, s = dx/dbeta, V the covariance of beta; the
joint covariance is [P + s V s', s V; V s', V]. Columns of s: payload, share of the Coriolis
forces, bias of each gauge; then, where parts count, each part and the gain of each gauge.
The same code runs with and without Numba; only two-dimensional products.
"""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED, compiled
import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtri

# Columns of s before the gauges' biases.
MASS, CORIOLIS, FIRST_BIAS = 0, 1, 2
# P's diagonal grows by this share a sample, above what rounding takes: a memory of 1e12 samples.
JITTER = 1e-12


def _whitener_by_lapack(matrix: Array) -> Array:
    factor, wrong = dpotrf(matrix, lower=True)
    if wrong:
        return np.full_like(matrix, np.nan)
    inverse, wrong = dtrtri(np.tril(factor), lower=True)
    return np.ascontiguousarray(inverse)


@compiled
def _whitener_by_loops(matrix: Array) -> Array:
    """Return L^-1 of matrix = L L'; NaN where it is not positive definite."""
    size = len(matrix)
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
            else:
                return np.full_like(matrix, np.nan)
    for c in range(size):
        inverse[c, c] = 1.0 / lower[c, c]
        for i in range(c + 1, size):
            total = 0.0
            for k in range(c, i):
                total -= lower[i, k] * inverse[k, c]
            inverse[i, c] = total / lower[i, i]
    return inverse


# LAPACK's calls are quicker only beside plain Python.
whitener = _whitener_by_loops if COMPILED else _whitener_by_lapack


@compiled
def _inner_by_loops(a: Array, b: Array) -> float:
    total = 0.0
    for k in range(len(a)):
        total += a[k] * b[k]
    return total


@compiled
def _applied_by_loops(matrix: Array, vector: Array) -> Array:
    found = np.zeros(len(matrix))
    for i in range(len(matrix)):
        total = 0.0
        for k in range(len(vector)):
            total += matrix[i, k] * vector[k]
        found[i] = total
    return found


@compiled
def _combined_by_loops(weights: Array, rows: Array) -> Array:
    found = np.zeros(rows.shape[1])
    for k in range(len(weights)):
        for j in range(rows.shape[1]):
            found[j] += weights[k] * rows[k, j]
    return found


@compiled
def _product_by_loops(a: Array, b: Array) -> Array:
    found = np.zeros((len(a), b.shape[1]))
    for i in range(len(a)):
        for k in range(len(b)):
            for j in range(b.shape[1]):
                found[i, j] += a[i, k] * b[k, j]
    return found


@compiled
def _squared_by_loops(a: Array, b: Array) -> Array:
    found = np.zeros((len(a), len(b)))
    for i in range(len(a)):
        for j in range(len(b)):
            total = 0.0
            for k in range(a.shape[1]):
                total += a[i, k] * b[j, k]
            found[i, j] = total
    return found


# a'b, A x, x'A, A B and A B'. Numba compiles loops in a tenth of the time of calls of BLAS, and
# for ten to thirty rows they are as quick; beside plain Python those are quicker.
inner = _inner_by_loops if COMPILED else np.dot
applied = _applied_by_loops if COMPILED else np.dot
combined = _combined_by_loops if COMPILED else np.dot
product = _product_by_loops if COMPILED else np.dot
squared = _squared_by_loops if COMPILED else lambda a, b: a @ b.T


@compiled
def _off_nominal(parts: Array, deviations: Array, drive: Array, moved: Array, first: int
                 ) -> tuple[Array, Array]:
    """Write d(M d)/d(part) into `moved`; return what the parts' deviations add to M and M d."""
    n, held, count = len(moved), len(moved) + 2, len(parts)
    moved[:, first:first + count] = applied(parts.reshape(-1, held), drive[:held]).reshape(-1, n).T
    off = combined(deviations, parts).reshape(n, held)
    return off[:, :n].copy(), applied(off, drive[:held])


@compiled
def _turn(x: Array, increment: Array, mass: float, share: float, turning: Array, matrix: Array,
          drive: Array) -> tuple[Array, Array]:
    """
    Return what the Coriolis forces add to x at share 1, and their Jacobian at this share.

    `drive` takes the two forces, at this share.
    """
    n, coordinates, held = x.size, turning.shape[1], x.size + 2
    # From the middle of the step, so that the scheme is of second order.
    middle = x + 0.5 * increment
    rate = middle[coordinates:2 * coordinates].copy()
    across = turning[1] + mass * turning[2]
    elbow, sigma = inner(turning[0], rate), inner(across, rate)
    root_1, root_2 = inner(turning[3], rate), inner(turning[4], rate)
    sine = np.sin(middle[1] + share * inner(turning[5], middle[:coordinates]))
    drive[held], drive[held + 1] = sine * sigma * root_2, -sine * elbow * root_1
    push = matrix[:, held] * drive[held] + matrix[:, held + 1] * drive[held + 1]
    drive[held:] *= share
    rows = np.zeros((2, n))
    rows[0, coordinates:2 * coordinates] = share * sine * (
        sigma * turning[4] + root_2 * across)
    rows[1, coordinates:2 * coordinates] = -share * sine * (
        elbow * turning[3] + root_1 * turning[0])
    return push, product(matrix[:, held:], rows)


@compiled
def predict(x: Array, cov: Array, sens: Array, anchor: Array, order: Array, value: Array,
            slopes: Array, parts: Array, away: float, command: Array, turning: Array,
            torque: Array) -> tuple[Array, Array, Array]:
    """
    Return state, covariance and sensitivity one sample later, delta form.

    x+ = x + M d with d = (x, u, Coriolis forces) and M = sum_k cos(k angle) M_k(m) + parts' dM,
    s+ = s + J s + dM/dbeta d, P+ = (I + J) P (I + J)' + Q, J = d(M d)/dx.

    Parameters
    ----------
    x, cov, sens, anchor : Array
        (n,), (n, n), (n, B) and the parameters that the model is evaluated at, (B,).
    order : Array
        0, 1, ... of the cosine series, (K,).
    value, slopes : Array
        See PayloadSlice.
    parts : Array
        dM/d(part) of states and commands at this angle, (p, n (n + 2)), p = 0 for exact parts.
    away : float
        m - slice payload, kg.
    command : Array
        u held over the sample, (2,).
    turning : Array
        See ExtendedModel; (0, N) without Coriolis forces.
    torque : Array
        Standard deviation of the command's disturbance, in its unit, (2,).

    """
    n, coordinates, share = x.size, turning.shape[1], anchor[CORIOLIS]
    width, lean, turns = n * (n + 4), 0.0, len(turning) > 0
    if turns:
        lean = inner(turning[5], x[:coordinates])
    angles = (x[1] + share * lean) * order
    wave = np.cos(angles)
    over = combined(wave, slopes)
    bend = away * over[width:]
    over_m = (over[:width] + bend).reshape(n, n + 4)
    matrix = combined(wave, value).reshape(n, n + 4) \
        + away * (over_m - 0.5 * bend.reshape(n, n + 4))
    over_angle = combined(-order * np.sin(angles), value).reshape(n, n + 4)
    drive = np.zeros(n + 4)
    drive[:n], drive[n:n + 2] = x, command
    moved, jacobian = np.zeros((n, anchor.size)), matrix[:, :n].copy()
    increment = applied(matrix, drive)
    if len(parts) > 0:
        first = FIRST_BIAS + (anchor.size - FIRST_BIAS - len(parts)) // 2
        off, more = _off_nominal(parts, anchor[first:first + len(parts)].copy(), drive, moved,
                                 first)
        jacobian, increment = jacobian + off, increment + more
    if turns:
        push, bent = _turn(x, increment, anchor[MASS], share, turning, matrix, drive)
        increment, jacobian = increment + share * push, jacobian + bent
        moved[:, CORIOLIS] = push
    turned = applied(over_angle, drive)
    if turns:
        moved[:, CORIOLIS] += lean * turned
        jacobian[:, :coordinates] += product(turned.reshape(-1, 1), share * turning[5:])
    jacobian[:, 1] += turned
    moved[:, MASS] = applied(over_m, drive)
    sens = sens + product(jacobian, sens) + moved
    noise = matrix[:, n:n + 2] * torque
    half = product(jacobian, cov)
    cov = cov + half + half.T + squared(half, jacobian) + squared(noise, noise)
    return x + increment, cov, sens


@compiled
def walk(cov: Array, sens: Array, spread: Array, variance: float
         ) -> tuple[Array, Array, Array]:
    """
    Return P, s and V after the payload walked at random by `variance`, kg^2, since the sample.

    Exact for the joint covariance: of what x was thought to owe to the payload, the part that
    the walk makes doubtful goes to P.
    """
    white = whitener(spread)
    row = combined(white[:, MASS].copy(), white)
    share = variance / (1.0 + variance * row[MASS])
    column = sens[:, MASS].copy()
    cov = cov + share * squared(column.reshape(-1, 1), column.reshape(-1, 1))
    sens = sens - share * squared(column.reshape(-1, 1), row.reshape(-1, 1))
    spread = spread.copy()
    spread[MASS, MASS] += variance
    return cov, sens, spread


@compiled
def _seen(x: Array, sens: Array, anchor: Array, offset: Array, output: Array, gains: int
          ) -> tuple[Array, Array, Array]:
    """Return what is expected of the outputs at the anchor, its slopes over x and over beta."""
    size, gauges = anchor.size, len(output) - 2
    base, factor = applied(output, x) + offset, np.ones(len(output))
    if gains > 0:
        factor[2:] += anchor[size - gains:]
    seen = output * factor.reshape(-1, 1)
    expected, psi = base * factor, product(seen, sens)
    expected[2:] += anchor[FIRST_BIAS:FIRST_BIAS + gauges]
    for g in range(gauges):
        psi[2 + g, FIRST_BIAS + g] += 1.0
        if gains > 0:
            psi[2 + g, size - gains + g] += base[2 + g]
    return expected, seen, psi


@compiled
def _shorter(cov: Array, gain: Array, seen: Array, noise: Array) -> Array:
    """Return P after a measurement, in Joseph's form."""
    keep = np.eye(len(cov)) - product(gain, seen)
    cov = squared(product(keep, cov), keep) + squared(gain * noise, gain)
    for i in range(len(cov)):
        cov[i, i] *= 1.0 + JITTER
    return 0.5 * (cov + cov.T)


@compiled
def correct(x: Array, cov: Array, sens: Array, beta: Array, spread: Array, anchor: Array,
            held: bool, measured: Array, offset: Array, output: Array, noise: Array, gains: int,
            gate: float, heaviest: float
            ) -> tuple[Array, Array, Array, Array, Array, Array, Array, Array, float]:
    """
    Return the posterior after a measurement, and what the measurement says of the model.

    Parameters
    ----------
    x, cov, sens, beta, spread : Array
        (n,), (n, n), (n, B), (B,) and V (B, B).
    anchor, held : Array, bool
        Parameters that all is linearised about, (B,), for which x is the state; it is x + s (beta
        - anchor) for beta. Where it is not held, the anchor follows beta, and x is taken there.
    measured, offset : Array
        y, and what y is beyond C x without gains and biases, (m,).
    output : Array
        C, (m, n).
    noise : Array
        Variance of each channel, (m,).
    gains : int
        Gauges whose gain is among beta: the last of its columns.
    gate : float
        Where e' Sigma^-1 e is beyond, the noise counts as large as makes it the gate: one
        absurd sample moves nothing, and many in a row are believed (Huber's influence).
    heaviest : float
        The payload stays in [0, heaviest], kg.

    Returns
    -------
    tuple
        x, P, s, beta, V; the innovation e; the variances of its channels; L^-1 e with L L' =
        Sigma before the gate, (m,); ln |Sigma| as it was used, NaN where the state is lost.

    """
    expected, seen, psi = _seen(x, sens, anchor, offset, output, gains)
    alone = measured - expected
    innovation = alone - applied(psi, beta - anchor)
    projected, learnt = squared(cov, seen), squared(spread, psi)
    known = product(seen, projected)
    total = known + product(psi, learnt) + np.diag(noise)
    white = whitener(total)
    scores = applied(white, innovation)
    misfit = inner(scores, scores)
    variances = np.diag(total).copy()
    if not misfit >= 0.0:
        return x, cov, sens, beta, spread, innovation, variances, scores, np.nan
    if misfit > gate:
        more = (misfit / gate - 1.0) * variances
        noise = noise + more
        white = whitener(total + np.diag(more))
    inverse = whitener(known + np.diag(noise))
    gain = product(squared(projected, inverse), inverse)
    learnt = squared(learnt, white)
    after = beta + applied(learnt, applied(white, innovation))
    after[MASS] = min(max(after[MASS], 0.0), heaviest)
    spread = spread - squared(learnt, learnt)
    sens = sens - product(gain, psi)
    x = x + applied(gain, alone)
    if not held:
        x = x + applied(sens, after - anchor)
    return (x, _shorter(cov, gain, seen, noise), sens, after, 0.5 * (spread + spread.T),
            innovation, variances, scores, -2.0 * np.log(np.diag(white)).sum())
