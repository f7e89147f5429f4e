"""
Products and factors of matrices of ten to thirty rows, with and without Numba.

Products of two matrices are BLAS's, which takes a third of compiled loops' time from six rows on;
products with a vector are loops where those are compiled, and BLAS's beside plain Python.
"""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED, compiled
from flex_plant_sim.tiny import TINY
import numpy as np
from scipy.linalg.lapack import dposv, dpotrf, dtrtri


def _whitener_by_lapack(matrix: Array) -> Array:
    # LAPACK works by columns: of U = L' there is nothing to turn round.
    factor, wrong = dpotrf(matrix.T)
    if wrong:
        return np.full_like(matrix, np.nan)
    found: Array = dtrtri(factor)[0].T
    return found


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
def _product_by_blas(a: Array, b: Array) -> Array:
    return np.dot(a, b)


@compiled
def _squared_by_blas(a: Array, b: Array) -> Array:
    # BLAS has a quicker way for small matrices that both lie row by row.
    return np.dot(a, b.T.copy())


# a'b, A x, x'A, A B and A B'.
inner = _inner_by_loops if COMPILED else np.dot
applied = _applied_by_loops if COMPILED else np.dot
combined = _combined_by_loops if COMPILED else np.dot
product = _product_by_blas if COMPILED else np.dot
squared = _squared_by_blas if COMPILED else lambda a, b: a @ b.T


def _inverse_column_by_lapack(matrix: Array) -> Array:
    right = np.zeros(len(matrix))
    right[0] = 1.0
    found: Array = dposv(matrix, right)[1]
    return found


@compiled
def _inverse_column_by_loops(matrix: Array) -> Array:
    """Return the first column of the inverse of a positive definite matrix."""
    size = len(matrix)
    # U' U with the first row factored last: two substitutions are then one.
    upper, found = np.zeros_like(matrix), np.zeros(size)
    for i in range(size):
        row = size - 1 - i
        for k in range(i):
            share = upper[k, i]
            for j in range(i, size):
                upper[i, j] -= share * upper[k, j]
        for j in range(i, size):
            upper[i, j] += matrix[row, size - 1 - j]
        root = np.sqrt(upper[i, i])
        for j in range(i, size):
            upper[i, j] /= root
    last = size - 1
    found[0] = 1.0 / upper[last, last]**2
    for i in range(last - 1, -1, -1):
        total = 0.0
        for j in range(i + 1, size):
            total -= upper[i, j] * found[last - j]
        found[last - i] = total / upper[i, i]
    return found


inverse_column = _inverse_column_by_loops if COMPILED else _inverse_column_by_lapack


def _inverse_by_numpy(matrix: Array) -> Array:
    found: Array = np.linalg.inv(matrix).astype(float)
    return found


@compiled
def _inverse_by_loops(matrix: Array) -> Array:
    """
    Return the inverse of a matrix near unity, (N, N), by Gauss and Jordan's elimination.

    It needs no pivoting, and lets pass what is not finite; compiled, NumPy's refuses that.
    """
    size = len(matrix)
    rest, found = matrix.copy(), np.eye(size)
    for i in range(size):
        pivot = rest[i, i] if rest[i, i] != 0.0 else TINY
        for k in range(size):
            rest[i, k] /= pivot
            found[i, k] /= pivot
        for j in range(size):
            share = rest[j, i]
            # Number by number: a row's difference would be another array each time.
            for k in range(size if j != i else 0):
                rest[j, k] -= share * rest[i, k]
                found[j, k] -= share * found[i, k]
    return found


inverse = _inverse_by_loops if COMPILED else _inverse_by_numpy
