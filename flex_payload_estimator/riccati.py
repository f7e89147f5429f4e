"""One Riccati iteration in delta form, for the predictor and for the controller alike."""

from __future__ import annotations

from flex_plant_sim.arm_model import Array
import numpy as np
from scipy.linalg.lapack import dposv


def riccati_step(a: Array, b: Array, q_1: Array, q_2: Array, s: Array,
                 step: float) -> tuple[Array, Array, Array]:
    """
    Return the gain L, the next S and the weight W of one iteration.

    W = Q_2 + T B' S B,  L = W^-1 B' S (I + T A),  N = A - B L,
    S+ = S + T (S N + N' S + T N' S N + Q_1 + L' Q_2 L).

    This is Joseph's form: S+ stays symmetric and positive definite for any rounding of L.
    The predictor is the dual: A', C', R_1 / T, T R_2, P gives K-bar' and T times the
    covariance of the innovation.

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
    product = s.dot(b)
    weight = q_2 + step * b.T.dot(product)
    _, gain, failure = dposv(weight, (product + step * a.T.dot(product)).T)
    if failure:
        raise FloatingPointError('riccati: expected a positive definite weight')
    closed = a - b.dot(gain)
    half = s.dot(closed)
    change = half + (0.5 * step) * closed.T.dot(half) + 0.5 * (q_1 + gain.T.dot(q_2.dot(gain)))
    return gain, s + step * (change + change.T), weight


def lyapunov_step(a: Array, q_1: Array, s: Array, step: float) -> Array:
    """Return S+ = S + T (S A + A' S + T A' S A + Q_1): an iteration without an input."""
    half = s.dot(a)
    change = half + (0.5 * step) * a.T.dot(half) + 0.5 * q_1
    following: Array = s + step * (change + change.T)
    return following


def settled(a: Array, b: Array, q_1: Array, q_2: Array, step: float,
            iterations: int = 20000, tolerance: float = 1e-12) -> tuple[Array, Array]:
    """Return the gain and S to which the iteration tends from S = T Q_1 + 1e-6 I."""
    s = step * q_1 + 1e-6 * np.eye(len(a))
    gain = np.zeros(b.T.shape)
    for _ in range(iterations):
        gain, following, _ = riccati_step(a, b, q_1, q_2, s, step)
        if float(np.max(np.abs(following - s))) <= tolerance * float(np.max(np.abs(s))):
            return gain, following
        s = following
    return gain, s
