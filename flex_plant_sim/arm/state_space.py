"""
Continuous state space of an arm at an operating point, and its exact zero-order hold.

It follows the second-order form; `schedule` tabulates the sampled matrices.
"""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array, SecondOrderForm
import numpy as np
from numpy.typing import ArrayLike

# Coefficients 1 / (k + 1)! of Psi, in rows of as many powers as are multiplied out, and the norm
# of A h up to which they suffice: the first term left out, 0.5^16 / 17!, is far below rounding.
SERIES = 1.0 / np.cumprod(np.arange(1.0, 17.0)).reshape(4, 4)
SCALED_NORM = 0.5


@dataclass(frozen=True)
class StateSpace:
    """
    x' = A x + B u + E f,  y = C x, at one or many operating points (the leading axes).

    Attributes
    ----------
    a : Array
        (…, n, n).
    b : Array
        (…, n, 2), from the commands.
    e : Array
        (…, n, N), from generalised forces on the coordinates.
    c : Array
        (…, m, n), to (theta_1, theta_2, strain…).

    """

    a: Array
    b: Array
    e: Array
    c: Array


def state_space(form: SecondOrderForm, cosine: ArrayLike, payload: ArrayLike) -> StateSpace:
    """
    Return the state space of x = (p, p') for c = cos(theta_2) (…,) and m_p, kg (…,).

    The output matrix is (17), with the joint angles in rad and the gauges in strain (m/m).
    """
    cosine = np.asarray(cosine, dtype=float)
    n = form.order
    mass = form.mass_at(cosine, payload)
    right = np.concatenate([
        form.stiffness_at(cosine),
        np.broadcast_to(form.damping, mass.shape),
        np.broadcast_to(form.input_matrix, mass.shape[:-1] + (2,)),
        np.broadcast_to(np.eye(n), mass.shape)], axis=-1)
    solved = np.linalg.solve(mass, right)
    a = np.zeros(mass.shape[:-2] + (2 * n, 2 * n))
    a[..., :n, n:] = np.eye(n)
    a[..., n:, :n], a[..., n:, n:] = -solved[..., :n], -solved[..., n:2 * n]
    b = np.zeros(mass.shape[:-2] + (2 * n, 2))
    b[..., n:, :] = solved[..., 2 * n:2 * n + 2]
    e = np.zeros(mass.shape[:-2] + (2 * n, n))
    e[..., n:, :] = solved[..., 2 * n + 2:]
    output = np.vstack([form.angle, form.strain])
    c = np.hstack([output, np.zeros_like(output)])
    return StateSpace(a, b, e, np.broadcast_to(c, a.shape[:-2] + c.shape))


def zero_order_hold(a: Array, b: Array, step: float) -> tuple[Array, Array]:
    """
    Return F = exp(A T) and G = int_0^T exp(A s) ds B, exact for an input held over T.

    Taylor series of Psi(A h) = sum (A h)^k / (k + 1)! at h = T / 2^s, six products by the scheme
    of Paterson and Stockmeyer (SIAM Journal on Computing 2 (1973)), then doubling:
    F(2h) = F^2, Psi(2h) = Psi (I + F) / 2, all points at once.

    Parameters
    ----------
    a, b : Array
        (…, n, n) and (…, n, m).
    step : float
        T, s.

    Raises
    ------
    numpy.linalg.LinAlgError
        A number of A is not finite.

    """
    norm = float(np.max(np.abs(a).sum(axis=-1), initial=0.0)) * step
    if not np.isfinite(norm):
        raise np.linalg.LinAlgError('zero-order hold of a plant whose numbers are not finite')
    doublings = int(np.ceil(np.log2(max(norm / SCALED_NORM, 1.0))))
    scaled = a * (step / 2.0**doublings)
    identity = np.eye(a.shape[-1])
    square = scaled @ scaled
    powers = np.stack([np.broadcast_to(identity, a.shape), scaled, square, square @ scaled])
    fourth, (*lower, psi) = square @ square, np.tensordot(SERIES, powers, 1)
    for row in reversed(lower):
        psi = row + fourth @ psi
    increment = scaled @ psi
    for _ in range(doublings):
        psi = psi + 0.5 * psi @ increment
        increment = 2.0 * increment + increment @ increment
    return identity + increment, step * psi @ b
