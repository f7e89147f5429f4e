"""
The split A = A^0 + m_p A^m, B = B^0 + m_p B^m, (13): as printed, resolvent and tangent.

It makes the model linear in the payload, which SF1's regression (24)-(28) needs.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Literal, NamedTuple

from flex_plant_sim.arm.paper_model import CompactForm
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED, compiled
from msg_config.errors import InputError
import numpy as np
from scipy.linalg.lapack import dgesv

SplitKind = Literal['paper', 'resolvent', 'tangent']
KINDS = ('paper', 'resolvent', 'tangent')


class Split(NamedTuple):
    """
    The split (13) at one theta_2 and one payload.

    Attributes
    ----------
    a, b : Array
        A (n, n) and B (n, 2) at the payload.
    a_m, b_m : Array
        A^m and B^m, per kg; A^0 = A - m_p A^m.
    a_slope, b_slope : Array
        dA/dm_p and dB/dm_p at the payload, per kg: A^m and B^m of the tangent split.
    mass : float
        m_p, kg.

    """

    a: Array
    b: Array
    a_m: Array
    b_m: Array
    a_slope: Array
    b_slope: Array
    mass: float

    @property
    def a_0(self) -> Array:
        """Return A^0."""
        return self.a - self.mass * self.a_m

    @property
    def b_0(self) -> Array:
        """Return B^0."""
        return self.b - self.mass * self.b_m


class CompactTerms(NamedTuple):
    """
    The terms of (12) at one theta_2, with f = 2n.

    Attributes
    ----------
    mass_0, mass_m : Array
        I - M_3^0 and M_3^m, (f, f).
    m_1, m_20, m_2m, m_50, m_5m : Array
        M_1, M_2^0, M_2^m (f, f), M_5^0, M_5^m (f, 2). M_4 vanishes.
    m_6, m_7 : Array
        (2, f) and (2, 2).
    frame : Array
        A without its last block row, (2 + 2f, 2 + 2f).

    """

    mass_0: Array
    mass_m: Array
    m_1: Array
    m_20: Array
    m_2m: Array
    m_50: Array
    m_5m: Array
    m_6: Array
    m_7: Array
    frame: Array

    @classmethod
    def of(cls, form: CompactForm) -> CompactTerms:
        """Return the terms of a compact form."""
        f = len(form.m_1)
        frame = np.zeros((2 + 2 * f, 2 + 2 * f))
        frame[:2, 2:2 + f], frame[2:2 + f, 2 + f:] = form.m_6, np.eye(f)
        return cls(np.eye(f) - form.m_3[0], form.m_3[1], form.m_1, *form.m_2, *form.m_5,
                   form.m_6, form.m_7, frame)

    def lam(self, mass: float) -> Array:
        """Return Lambda = (I - M_3)^-1, (f, f)."""
        return inverse(self.mass_0 - mass * self.mass_m)


@compiled
def terms_at(cosine: float, table: Array, m_6: Array, m_7: Array, frame: Array) -> CompactTerms:
    """Return the terms at cos(theta_2); row i of the table belongs to its power i."""
    f, width = m_6.shape[1], table.shape[1]
    row = np.dot(np.array([1.0, cosine, cosine * cosine]), table)
    square, narrow = row[:5 * f * f].reshape(5, f, f), row[5 * f * f:width].reshape(2, f, 2)
    return CompactTerms(square[0], square[1], square[2], square[3], square[4], narrow[0],
                        narrow[1], m_6, m_7, frame)


@lru_cache
def _unit(size: int) -> Array:
    return np.eye(size)


def _inverse_by_lapack(matrix: Array) -> Array:
    # Transposed twice: LAPACK works on columns, and the products that follow are faster on rows.
    found: Array = dgesv(matrix.T, _unit(len(matrix)))[2].T
    return found


@compiled
def _inverse_by_loops(matrix: Array) -> Array:
    """Return the inverse by Gauss-Jordan elimination with partial pivoting."""
    size = len(matrix)
    rest, found = matrix.copy(), np.eye(size)
    for c in range(size):
        p = c + np.argmax(np.abs(rest[c:, c]))
        for k in range(size):
            rest[c, k], rest[p, k] = rest[p, k], rest[c, k]
            found[c, k], found[p, k] = found[p, k], found[c, k]
        scale = 1.0 / rest[c, c]
        for k in range(size):
            rest[c, k] *= scale
            found[c, k] *= scale
        for i in range(size):
            share = rest[i, c]
            if i != c and share != 0.0:
                for k in range(size):
                    rest[i, k] -= share * rest[c, k]
                    found[i, k] -= share * found[c, k]
    return found


# A LAPACK call beats the loops only where they are not compiled.
inverse = _inverse_by_loops if COMPILED else _inverse_by_lapack


def check_kind(kind: str) -> None:
    """
    Check the name of a split.

    Raises
    ------
    InputError
        kind is not one of KINDS.

    """
    if kind not in KINDS:
        raise InputError(f'split: expected one of {", ".join(KINDS)}, got {kind!r}')


def check_second_order(kind: str) -> None:
    """
    Check that a second-order model has the split.

    Raises
    ------
    InputError
        kind is 'paper', or not one of KINDS.

    """
    check_kind(kind)
    if kind == 'paper':
        raise InputError('split: expected resolvent or tangent for a second-order model, got '
                         "'paper', which needs model paper_reduced")


def split_compact(terms: CompactTerms, mass: float, kind: SplitKind = 'resolvent') -> Split:
    """
    Return the split of the reduced model (12).

    Parameters
    ----------
    terms : CompactTerms
        The terms at theta_2.
    mass : float
        A priori m_p, kg.
    kind : str
        'paper': (15), (16), Lambda frozen. 'resolvent': by Lambda = Lambda_0 + m_p Lambda M_3^m
        Lambda_0, so that A^0 = A(0) and A^m is the secant from 0 to m_p. 'tangent': A^m = dA/dm_p.

    """
    check_kind(kind)
    lam = terms.lam(mass)
    a, b, rate, jump = _compact_parts(terms, lam, mass)
    through, stiffness = lam.dot(terms.mass_m), a[-len(lam):, 2:2 + len(lam)]
    rate_m, jump_m = lam.dot(terms.m_2m), lam.dot(terms.m_5m)
    slope = _payload_blocks(len(lam), through.dot(stiffness), rate_m + through.dot(rate),
                            jump_m + through.dot(jump), rate, jump)
    if kind == 'tangent':
        return Split(a, b, *slope, *slope, mass)
    if kind == 'paper':
        # B^m_3 = Lambda M_2^m Lambda M_5^0 + Lambda M_2^0 Lambda M_5^m, (15)
        frozen = _payload_blocks(len(lam), np.zeros_like(lam), rate_m, jump_m,
                                 lam.dot(terms.m_20), lam.dot(terms.m_50))
        return Split(a, b, *frozen, *slope, mass)
    lam_0 = terms.lam(0.0)
    jump_0 = lam_0.dot(terms.m_50)
    secant = _payload_blocks(len(lam), through.dot(lam_0.dot(terms.m_1)),
                             rate_m + through.dot(lam_0.dot(terms.m_20)),
                             jump_m + through.dot(jump_0), rate, jump_0)
    return Split(a, b, *secant, *slope, mass)


def compact_state(terms: CompactTerms, mass: float) -> tuple[Array, Array]:
    """Return A and B of (12) at m_p, kg, without a split."""
    return _compact_parts(terms, terms.lam(mass), mass)[:2]


def _compact_parts(terms: CompactTerms, lam: Array,
                   mass: float) -> tuple[Array, Array, Array, Array]:
    """Return A, B, X = Lambda M_2 and J = Lambda M_5 of (12)."""
    f = len(lam)
    rate = lam.dot(terms.m_20 + mass * terms.m_2m)
    jump = lam.dot(terms.m_50 + mass * terms.m_5m)
    a, b = terms.frame.copy(), np.empty((2 + 2 * f, 2))
    a[2 + f:, 2:2 + f] = lam.dot(terms.m_1)
    a[2 + f:, 2 + f:] = rate
    b[:2], b[2:2 + f], b[2 + f:] = terms.m_7, jump, rate.dot(jump)
    return a, b, rate, jump


def _payload_blocks(f: int, stiffness_m: Array, rate_m: Array, jump_m: Array, rate: Array,
                    jump: Array) -> tuple[Array, Array]:
    """Return A^m and B^m from their blocks; the last of B^m is (X J)^m = X^m J + X J^m."""
    a, b = np.zeros((2 + 2 * f, 2 + 2 * f)), np.zeros((2 + 2 * f, 2))
    a[2 + f:, 2:2 + f] = stiffness_m
    a[2 + f:, 2 + f:] = rate_m
    b[2:2 + f], b[2 + f:] = jump_m, rate_m.dot(jump) + rate.dot(jump_m)
    return a, b


@compiled
def second_order_state(table: Array, order: int, cosine: float, mass: float
                       ) -> tuple[Array, Array]:
    """
    Return A and B of x = (p, p') at cos(theta_2) and m_p, kg.

    Parameters
    ----------
    table : Array
        Coefficients of [M_0, M^m, -K, -D, B] at the powers 0, 1 and 2 of cos(theta_2),
        (3, N (4N + 2)).
    order : int
        N, the number of coordinates p.
    cosine, mass : float
        cos(theta_2) and m_p, kg.

    """
    n = order
    row = np.dot(np.array([1.0, cosine, cosine * cosine]), table).reshape(n, 4 * n + 2)
    bottom = np.linalg.solve(row[:, :n] + mass * row[:, n:2 * n], row[:, 2 * n:].copy())
    a, b = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 2))
    for i in range(n):
        a[i, n + i] = 1.0
    a[n:], b[n:] = bottom[:, :2 * n], bottom[:, 2 * n:]
    return a, b


def split_second_order(mass_0: Array, mass_m: Array, right: Array, mass: float,
                       kind: SplitKind = 'resolvent') -> Split:
    """
    Return the split of x = (p, p') with Lambda = M^-1, M = mass_0 + m_p mass_m.

    'resolvent' uses Lambda = Lambda_0 - m_p Lambda M^m Lambda_0, 'tangent' dLambda/dm_p
    = -Lambda M^m Lambda. The payload enters through Lambda alone, so (15), which freezes Lambda,
    would leave nothing to estimate.

    Parameters
    ----------
    mass_0, mass_m : Array
        (N, N).
    right : Array
        [-K, -D, B], (N, 2N + 2).
    mass : float
        m_p, kg.
    kind : str
        'resolvent' or 'tangent'.

    Raises
    ------
    InputError
        kind is 'paper', or not one of KINDS.

    """
    check_second_order(kind)
    n = len(mass_0)
    whole = dgesv(mass_0 + mass * mass_m, np.hstack([right, mass_m]))[2]
    solved, through = whole[:, :2 * n + 2], -whole[:, 2 * n + 2:]
    base = dgesv(mass_0, right)[2] if kind == 'resolvent' else solved
    secant, slope = (_first_order(through.dot(bottom), np.zeros((n, n)))
                     for bottom in (base, solved))
    return Split(*_first_order(solved, np.eye(n)), *secant, *slope, mass)


def _first_order(bottom: Array, identity: Array) -> tuple[Array, Array]:
    """Return A and B of x = (p, p') from the bottom rows [A, B] and the top right block of A."""
    n = len(bottom)
    a, b = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 2))
    a[:n, n:], a[n:], b[n:] = identity, bottom[:, :2 * n], bottom[:, 2 * n:]
    return a, b
