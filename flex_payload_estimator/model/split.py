"""
The split A = A^0 + m_p A^m, B = B^0 + m_p B^m, (13), applied to one state and command.

It makes the model linear in the payload, which SF1's regression (24)-(28) needs: as printed, (15),
(16), with Lambda frozen, or by the resolvent identity Lambda = Lambda_0 + m_p Lambda M_3^m
Lambda_0, so that A^0 = A(0) and A^m is the secant from 0 to m_p.
"""

from __future__ import annotations

from flex_payload_estimator.model.tabulated import inverse, Tables, terms_at, times
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
import numpy as np


@compiled
def _compact_rates(cosine: float, tables: Tables, mass: float, other: float, state: Array,
                   command: Array, as_printed: bool) -> tuple[Array, Array, Array]:
    """
    Return A of (12), A^m and the rows of `rates_at` at cos(theta_2).

    With j = Lambda M_5 u, v = z + j (that is q') and r = Lambda (M_1 q + M_2 v), the secant to
    another payload, whose Lambda and M_2 are primed, is j' = Lambda' (M_3^m j + M_5^m u) and
    r' = Lambda' (M_3^m r + M_2^m v + M_2' j'). Where both payloads are equal, it is the tangent.
    """
    terms = terms_at(cosine, *tables)
    f, lam = len(terms.m_1), inverse(terms.mass_0 - mass * terms.mass_m)
    q, z = np.ascontiguousarray(state[2:2 + f]), np.ascontiguousarray(state[2 + f:])
    m_2 = terms.m_20 + mass * terms.m_2m
    stiffness, rate = np.dot(lam, terms.m_1), np.dot(lam, m_2)
    fixed, linear = times(terms.m_50, command), times(terms.m_5m, command)
    jump = times(lam, fixed + mass * linear)
    velocity = z + jump
    acceleration = times(stiffness, q) + times(rate, velocity)
    lam_other = lam if other == mass else inverse(terms.mass_0 - other * terms.mass_m)
    jump_slope = times(lam_other, times(terms.mass_m, jump) + linear)
    slope = times(lam_other, times(terms.mass_m, acceleration) + times(terms.m_2m, velocity)
                  + times(terms.m_20 + other * terms.m_2m, jump_slope))
    derivatives = np.zeros((3, 2 + 2 * f))
    derivatives[0, :2] = times(terms.m_6, q) + times(terms.m_7, command)
    derivatives[0, 2:2 + f], derivatives[0, 2 + f:] = velocity, acceleration
    derivatives[2, 2:2 + f], derivatives[2, 2 + f:] = jump_slope, slope
    a, a_m = terms.frame.copy(), np.zeros(terms.frame.shape)
    a[2 + f:, 2:2 + f], a[2 + f:, 2 + f:] = stiffness, rate
    if as_printed:
        jump_m = times(lam, linear)
        a_m[2 + f:, 2 + f:] = np.dot(lam, terms.m_2m)
        velocity_0, coupled = z + times(lam, fixed), times(terms.m_20, jump_m)
        derivatives[1, 2 + f:] = times(lam, times(terms.m_2m, velocity_0) + coupled)
    else:
        base = inverse(terms.mass_0)
        start, through = times(base, fixed), np.dot(terms.mass_m, base)
        of_q, of_z = np.dot(through, terms.m_1), np.dot(through, terms.m_20) + terms.m_2m
        jump_m = times(lam, times(terms.mass_m, start) + linear)
        a_m[2 + f:, 2:2 + f], a_m[2 + f:, 2 + f:] = np.dot(lam, of_q), np.dot(lam, of_z)
        derivatives[1, 2 + f:] = times(lam, times(of_q, q) + times(of_z, z + start)) \
            + times(rate, jump_m)
    derivatives[1, 2:2 + f] = jump_m
    return a, a_m, derivatives


@compiled
def _second_order_rates(cosine: float, table: Array, mass: float, other: float, state: Array,
                        command: Array) -> tuple[Array, Array, Array]:
    """
    Return A, A^m and the rows of `rates_at` of x = (p, p').

    With r = p'' the secant to another payload is -Lambda' M^m r. The resolvent split is the
    secant from zero payload, -Lambda M^m r(m_p = 0).
    """
    n = len(state) // 2
    row = np.dot(np.array([1.0, cosine, cosine * cosine]), table).reshape(n, 4 * n + 2)
    mass_0, mass_m = row[:, :n].copy(), row[:, n:2 * n].copy()
    right, joined = row[:, 2 * n:].copy(), np.concatenate((state, command))
    lam = inverse(mass_0 + mass * mass_m)
    solved, through = np.dot(lam, right), -np.dot(lam, mass_m)
    share = np.dot(through, np.dot(inverse(mass_0), right))
    acceleration = times(solved, joined)
    lam_other = lam if other == mass else inverse(mass_0 + other * mass_m)
    derivatives = np.zeros((3, 2 * n))
    derivatives[0, :n], derivatives[0, n:] = state[n:], acceleration
    derivatives[1, n:] = times(share, joined)
    derivatives[2, n:] = -times(lam_other, times(mass_m, acceleration))
    a, a_m = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 2 * n))
    for i in range(n):
        a[i, n + i] = 1.0
    a[n:], a_m[n:] = solved[:, :2 * n], share[:, :2 * n]
    return a, a_m, derivatives


@compiled
def rates_at(cosine: float, tables: Tables, mass: float, other: float, state: Array,
             command: Array, as_printed: bool) -> tuple[Array, Array, Array]:
    """
    Return A and A^m (n, n), and the rows A x + B u, A^m x + B^m u, A' x + B' u, (3, n).

    A' = (A(other) - A(mass)) / (other - mass), B' likewise: the secant between two payloads, kg;
    the derivative where both are equal. Only the compact model has the split as printed: in a
    second-order one the payload enters through Lambda alone, which (15) freezes.
    """
    if tables[3].size == 0:
        return _second_order_rates(cosine, tables[0], mass, other, state, command)
    return _compact_rates(cosine, tables, mass, other, state, command, as_printed)
