"""
A and B of the arm over cos(theta_2) and the payload m_p, from what is tabulated once per robot.

Products and inverses of small matrices beside them: loops where they are compiled, else libraries.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

from flex_plant_sim.arm.paper_model import CompactForm
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED, compiled
import numpy as np
from scipy.linalg.lapack import dgesv

# Tables of a model: the arguments of `terms_at`; of a second-order model the table of
# `second_order_state` and three empty arrays.
Tables = tuple[Array, Array, Array, Array]


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


@compiled
def _times_by_loops(matrix: Array, vector: Array) -> Array:
    found = np.zeros(len(matrix))
    for i in range(len(matrix)):
        for j in range(len(vector)):
            found[i] += matrix[i, j] * vector[j]
    return found


# Product of a small matrix and a vector: compiled loops take a tenth of the time of a BLAS call.
times = _times_by_loops if COMPILED else np.dot


def compact_state(terms: CompactTerms, mass: float) -> tuple[Array, Array]:
    """Return A and B of (12) at m_p, kg."""
    lam = terms.lam(mass)
    f = len(lam)
    rate = lam.dot(terms.m_20 + mass * terms.m_2m)
    jump = lam.dot(terms.m_50 + mass * terms.m_5m)
    a, b = terms.frame.copy(), np.empty((2 + 2 * f, 2))
    a[2 + f:, 2:2 + f] = lam.dot(terms.m_1)
    a[2 + f:, 2 + f:] = rate
    b[:2], b[2:2 + f], b[2 + f:] = terms.m_7, jump, rate.dot(jump)
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
