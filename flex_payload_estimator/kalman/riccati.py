"""One Riccati iteration in delta form, for the predictor and for the controller alike."""

from __future__ import annotations

from flex_payload_estimator.kalman.in_place import add_both, add_matrix
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED, compiled
from flex_plant_sim.riccati import settled_cost
import numpy as np
from scipy.linalg.lapack import dposv


def _solve_by_lapack(matrix: Array, right: Array) -> tuple[Array, bool]:
    _, found, failure = dposv(matrix, right)
    return found, failure == 0


@compiled
def _solve_by_loops(matrix: Array, right: Array) -> tuple[Array, bool]:
    """Return X of M X = R, and whether M (m, m) is positive definite; by Cholesky's factors."""
    size, width = right.shape
    lower, found = np.zeros((size, size)), right.copy()
    for i in range(size):
        for j in range(i + 1):
            rest = matrix[i, j]
            for k in range(j):
                rest -= lower[i, k] * lower[j, k]
            if i > j:
                lower[i, j] = rest / lower[j, j]
            elif rest > 0.0:
                lower[i, i] = np.sqrt(rest)
            else:
                return found, False
    for i in range(size):
        for k in range(i):
            for c in range(width):
                found[i, c] -= lower[i, k] * found[k, c]
        for c in range(width):
            found[i, c] /= lower[i, i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            for c in range(width):
                found[i, c] -= lower[k, i] * found[k, c]
        for c in range(width):
            found[i, c] /= lower[i, i]
    return found, True


# LAPACK's call costs as much as the loops where these are compiled, and much less where not.
solve_positive = _solve_by_loops if COMPILED else _solve_by_lapack


@compiled
def riccati_step(a: Array, b: Array, q_1: Array, q_2: Array, s: Array,
                 step: float) -> tuple[Array, Array, Array]:
    """
    Return the gain L, the next S and the closed loop N of one iteration.

    W = Q_2 + T B' S B,  L = W^-1 B' S (I + T A),  N = A - B L,
    S+ = S + T (S N + N' S + T N' S N + Q_1 + L' Q_2 L).

    This is Joseph's form: S+ stays symmetric and positive definite for any rounding of L.
    The predictor is the dual: A', C', R_1 / T, T R_2, P gives K-bar', and (A - K-bar C)'.

    Parameters
    ----------
    a, b : Array
        A-bar (n, n), B-bar (n, m) of the delta model.
    q_1, q_2 : Array
        (n, n) and (m, m).
    s : Array
        (n, n), symmetric.
    step : float
        T, s.

    Raises
    ------
    FloatingPointError
        W is not positive definite, or not finite.

    """
    image = np.dot(s, b)
    weight = q_2.copy()
    add_matrix(weight, step, np.dot(b.T, image))
    add_matrix(image, step, np.dot(a.T, image))
    gain, positive = solve_positive(weight, image.T)
    if not positive:
        raise FloatingPointError('riccati: expected a positive definite weight')
    closed = a - np.dot(b, gain)
    half, found = np.dot(s, closed), s.copy()
    add_matrix(half, 0.5 * step, np.dot(closed.T, half))
    add_matrix(half, 0.5, np.dot(gain.T, np.dot(q_2, gain)))
    add_matrix(half, 0.5, q_1)
    add_both(found, step, half)
    return gain, found, closed


@compiled
def lyapunov_step(a: Array, q_1: Array, s: Array, step: float) -> Array:
    """
    Return S+ = S + T (S A + A' S + T A' S A + Q_1): an iteration without an input.

    All are (n, n); `step` is T, s.
    """
    half, found = np.dot(s, a), s.copy()
    add_matrix(half, 0.5 * step, np.dot(a.T, half))
    add_matrix(half, 0.5, q_1)
    add_both(found, step, half)
    return found


def settled(a: Array, b: Array, q_1: Array, q_2: Array, step: float) -> tuple[Array, Array]:
    """
    Return the gain (m, n) and the S (n, n) to which the iteration tends, see `settled_cost`.

    Of A (n, n), B (n, m), Q_1 (n, n), Q_2 (m, m); `step` is T, s.

    Raises
    ------
    FloatingPointError
        It does not settle: a mode that does not decay is out of the controls' reach, or costs
        nothing.

    """
    cost = settled_cost(step * a, step * b.dot(np.linalg.solve(q_2, b.T)), step * q_1)
    gain, s, _ = riccati_step(a, b, q_1, q_2, cost, step)
    return gain, s
