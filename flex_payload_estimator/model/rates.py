"""The split (13) applied to one state and command: a few products with vectors."""

from __future__ import annotations

from flex_payload_estimator.model.split import inverse, terms_at
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED, compiled
import numpy as np

# Of a model: those of `split.terms_at`; of a second-order one `split.second_order_state`'s and
# three empty ones.
Tables = tuple[Array, Array, Array, Array]


@compiled
def _times_by_loops(matrix: Array, vector: Array) -> Array:
    found = np.zeros(len(matrix))
    for i in range(len(matrix)):
        for j in range(len(vector)):
            found[i] += matrix[i, j] * vector[j]
    return found


# A matrix of this size by a vector: compiled, loops take a tenth of a call of BLAS.
times = _times_by_loops if COMPILED else np.dot


@compiled
def _compact_rates(cosine: float, tables: Tables, mass: float, other: float, state: Array,
                   command: Array, as_printed: bool, resolvent: bool
                   ) -> tuple[Array, Array, Array]:
    """
    Return A of (12), A^m and the columns of `PayloadModel.rates` at cos(theta_2).

    With j = Lambda M_5 u, v = z + j (that is q') and r = Lambda (M_1 q + M_2 v), the secant to
    another payload, whose Lambda and M_2 are primed, is j' = Lambda' (M_3^m j + M_5^m u) and
    r' = Lambda' (M_3^m r + M_2^m v + M_2' j'); where both payloads are one, it is the tangent.
    """
    terms = terms_at(cosine, *tables)
    f, lam = len(terms.m_1), inverse(terms.mass_0 - mass * terms.mass_m)
    q, z = np.ascontiguousarray(state[2:2 + f]), np.ascontiguousarray(state[2 + f:])
    m_2 = terms.m_20 + mass * terms.m_2m
    stiffness, rate = np.dot(lam, terms.m_1), np.dot(lam, m_2)
    fixed, linear = times(terms.m_50, command), times(terms.m_5m, command)
    jump = times(lam, fixed + mass * linear)
    velocity = z + jump
    change = times(stiffness, q) + times(rate, velocity)
    beyond = lam if other == mass else inverse(terms.mass_0 - other * terms.mass_m)
    jump_slope = times(beyond, times(terms.mass_m, jump) + linear)
    slope = times(beyond, times(terms.mass_m, change) + times(terms.m_2m, velocity)
                  + times(terms.m_20 + other * terms.m_2m, jump_slope))
    columns = np.zeros((3, 2 + 2 * f))
    columns[0, :2] = times(terms.m_6, q) + times(terms.m_7, command)
    columns[0, 2:2 + f], columns[0, 2 + f:] = velocity, change
    columns[2, 2:2 + f], columns[2, 2 + f:] = jump_slope, slope
    a, a_m = terms.frame.copy(), np.zeros(terms.frame.shape)
    a[2 + f:, 2:2 + f], a[2 + f:, 2 + f:] = stiffness, rate
    if as_printed:
        part = times(lam, linear)
        a_m[2 + f:, 2 + f:] = np.dot(lam, terms.m_2m)
        before, beside = z + times(lam, fixed), times(terms.m_20, part)
        columns[1, 2 + f:] = times(lam, times(terms.m_2m, before) + beside)
    else:
        base, m_2 = (inverse(terms.mass_0), terms.m_20) if resolvent else (lam, m_2)
        start = times(base, fixed if resolvent else fixed + mass * linear)
        through = np.dot(terms.mass_m, base)
        of_q, of_z = np.dot(through, terms.m_1), np.dot(through, m_2) + terms.m_2m
        part = times(lam, times(terms.mass_m, start) + linear)
        a_m[2 + f:, 2:2 + f], a_m[2 + f:, 2 + f:] = np.dot(lam, of_q), np.dot(lam, of_z)
        columns[1, 2 + f:] = times(lam, times(of_q, q) + times(of_z, z + start)) \
            + times(rate, part)
    columns[1, 2:2 + f] = part
    return a, a_m, columns


@compiled
def _second_order_rates(cosine: float, table: Array, mass: float, other: float, state: Array,
                        command: Array, resolvent: bool) -> tuple[Array, Array, Array]:
    """
    Return A, A^m and the columns of `PayloadModel.rates` of x = (p, p').

    With r = p'' the secant to another payload is -Lambda' M^m r; the resolvent's, from none,
    -Lambda M^m r(m_p = 0).
    """
    n = len(state) // 2
    row = np.dot(np.array([1.0, cosine, cosine * cosine]), table).reshape(n, 4 * n + 2)
    mass_0, mass_m = row[:, :n].copy(), row[:, n:2 * n].copy()
    right, joined = row[:, 2 * n:].copy(), np.concatenate((state, command))
    lam = inverse(mass_0 + mass * mass_m)
    solved, through = np.dot(lam, right), -np.dot(lam, mass_m)
    base = np.dot(inverse(mass_0), right) if resolvent else solved
    share, change = np.dot(through, base), times(solved, joined)
    beyond = lam if other == mass else inverse(mass_0 + other * mass_m)
    columns = np.zeros((3, 2 * n))
    columns[0, :n], columns[0, n:] = state[n:], change
    columns[1, n:] = times(share, joined)
    columns[2, n:] = -times(beyond, times(mass_m, change))
    a, a_m = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 2 * n))
    for i in range(n):
        a[i, n + i] = 1.0
    a[n:], a_m[n:] = solved[:, :2 * n], share[:, :2 * n]
    return a, a_m, columns


@compiled
def rates_at(cosine: float, tables: Tables, mass: float, other: float, state: Array,
             command: Array, as_printed: bool, resolvent: bool) -> tuple[Array, Array, Array]:
    """Return what `PayloadModel.rates` does, of either kind of model, at cos(theta_2)."""
    if tables[3].size == 0:
        return _second_order_rates(cosine, tables[0], mass, other, state, command, resolvent)
    return _compact_rates(cosine, tables, mass, other, state, command, as_printed, resolvent)
