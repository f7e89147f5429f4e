"""The split (13) applied to one state and command: a few products with vectors."""

from __future__ import annotations

from flex_payload_estimator.model.split import (
    check_kind,
    CompactTerms,
    inverse,
    SplitKind,
    terms_at,
)
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED, compiled
from msg_config.errors import InputError
import numpy as np
from scipy.linalg.lapack import dgesv


def compact_rates(terms: CompactTerms, mass: float, state: Array, command: Array,
                  kind: SplitKind) -> tuple[Array, Array]:
    """
    Return A of (12) and the columns A x + B u, A^m x + B^m u, A' x + B' u.

    With j = Lambda M_5 u, v = z + j (that is q') and r = Lambda (M_1 q + M_2 v), the tangent is
    j' = Lambda (M_3^m j + M_5^m u), r' = Lambda (M_3^m r + M_2^m v + M_2 j').

    Parameters
    ----------
    terms : CompactTerms
        At theta_2.
    mass : float
        m_p, kg.
    state, command : Array
        (n,) and (2,).
    kind : str
        'paper', 'resolvent' or 'tangent'.

    Returns
    -------
    tuple of Array
        (n, n) and (n, 3).

    """
    check_kind(kind)
    return _compact_rates(terms, float(mass), state, command, kind == 'paper',
                          kind == 'resolvent')


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
def _compact_rates(terms: CompactTerms, mass: float, state: Array, command: Array,
                   as_printed: bool, resolvent: bool) -> tuple[Array, Array]:
    f = len(terms.m_1)
    lam = inverse(terms.mass_0 - mass * terms.mass_m)
    q, z = state[2:2 + f], state[2 + f:]
    stiffness = np.dot(lam, terms.m_1)
    rate = np.dot(lam, terms.m_20 + mass * terms.m_2m)
    fixed, linear = times(terms.m_50, command), times(terms.m_5m, command)
    jump = times(lam, fixed + mass * linear)
    velocity = z + jump
    change = times(stiffness, q) + times(rate, velocity)
    jump_slope = times(lam, times(terms.mass_m, jump) + linear)
    slope = times(lam, times(terms.mass_m, change) + times(terms.m_2m, velocity)) \
        + times(rate, jump_slope)
    part, last = jump_slope, slope
    if as_printed:
        part = times(lam, linear)
        last = times(lam, times(terms.m_2m, z + times(lam, fixed)) + times(terms.m_20, part))
    elif resolvent:
        lam_0 = inverse(terms.mass_0)
        empty_jump = times(lam_0, fixed)
        before = z + empty_jump
        empty = times(lam_0, times(terms.m_1, q) + times(terms.m_20, before))
        part = times(lam, times(terms.mass_m, empty_jump) + linear)
        last = times(lam, times(terms.mass_m, empty) + times(terms.m_2m, before)) \
            + times(rate, part)
    columns = np.zeros((3, 2 + 2 * f))
    columns[0, :2] = times(terms.m_6, q) + times(terms.m_7, command)
    columns[0, 2:2 + f], columns[0, 2 + f:] = velocity, change
    columns[1, 2:2 + f], columns[1, 2 + f:] = part, last
    columns[2, 2:2 + f], columns[2, 2 + f:] = jump_slope, slope
    a = terms.frame.copy()
    a[2 + f:, 2:2 + f], a[2 + f:, 2 + f:] = stiffness, rate
    return a, columns.T


@compiled
def rates_at(cosine: float, table: Array, m_6: Array, m_7: Array, frame: Array, mass: float,
             state: Array, command: Array, as_printed: bool, resolvent: bool
             ) -> tuple[Array, Array]:
    """Return `compact_rates` at cos(theta_2), see `terms_at`."""
    return _compact_rates(terms_at(cosine, table, m_6, m_7, frame), mass,
                          np.ascontiguousarray(state), np.ascontiguousarray(command),
                          as_printed, resolvent)


def second_order_rates(mass_0: Array, mass_m: Array, right: Array, mass: float, state: Array,
                       command: Array, kind: SplitKind) -> tuple[Array, Array]:
    """
    Return A and the columns A x + B u, A^m x + B^m u, A' x + B' u of x = (p, p').

    With r = p'' the tangent is -Lambda M^m r, the resolvent's secant -Lambda M^m r(m_p = 0).

    Raises
    ------
    InputError
        kind is 'paper'.

    """
    check_kind(kind)
    if kind == 'paper':
        raise InputError('split: expected resolvent or tangent for a second-order model, got '
                         "'paper', which needs model paper_reduced")
    n = len(mass_0)
    solved = dgesv(mass_0 + mass * mass_m, np.hstack([right, mass_m]))[2]
    joined = np.concatenate([state, command])
    change = solved[:, :2 * n + 2].dot(joined)
    columns = np.zeros((2 * n, 3))
    columns[:n, 0], columns[n:, 0] = state[n:], change
    columns[n:, 2] = -solved[:, 2 * n + 2:].dot(change)
    columns[n:, 1] = columns[n:, 2]
    if kind == 'resolvent':
        columns[n:, 1] = -solved[:, 2 * n + 2:].dot(dgesv(mass_0, right.dot(joined))[2])
    a = np.zeros((2 * n, 2 * n))
    a[:n, n:].flat[::n + 1] = 1.0
    a[n:] = solved[:, :2 * n]
    return a, columns
