"""
In-place sums and products of small arrays for the compiled steps of estimators and controller.

Numba compiles an array expression into some kilobytes of code and a temporary array, and each
slice in it likewise. Dozens of them fill the cache in a step that runs once in 10 ms, beside
everything else that runs then. Loops take a tenth of that. Without Numba the same names are NumPy
expressions.
"""

from __future__ import annotations

from collections.abc import Sequence

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED, compiled
import numpy as np

# An array, compiled or not, or a list of its numbers.
Numbers = Array | Sequence[float]


@compiled
def _put_by_loops(out: Array, values: Array) -> None:
    for i in range(out.size):
        out[i] = values[i]


@compiled
def _put_matrix_by_loops(out: Array, values: Array) -> None:
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = values[i, j]


@compiled
def _add_by_loops(out: Array, share: float, values: Array) -> None:
    for i in range(out.size):
        out[i] += share * values[i]


@compiled
def _add_matrix_by_loops(out: Array, share: float, values: Array) -> None:
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] += share * values[i, j]


def _add_by_numpy(out: Array, share: float, values: Array) -> None:
    # Most often the share is 1, and a product would take as long as the sum.
    out += values if share == 1.0 else share * values


@compiled
def _add_column_by_loops(out: Array, column: int, share: float, values: Array) -> None:
    for i in range(len(out)):
        out[i, column] += share * values[i]


def _add_column_by_numpy(out: Array, column: int, share: float, values: Array) -> None:
    out[:, column] += share * values


@compiled
def _add_outer_by_loops(out: Array, x: Array, y: Array) -> None:
    for i in range(len(x)):
        for j in range(len(y)):
            out[i, j] += x[i] * y[j]


def _add_outer_by_numpy(out: Array, x: Array, y: Array) -> None:
    out += x[:, None] * y


@compiled
def _add_diagonal_by_loops(out: Array, values: Array) -> None:
    for i in range(len(values)):
        out[i, i] += values[i]


def _add_diagonal_by_numpy(out: Array, values: Array) -> None:
    out.ravel()[::len(out) + 1] += values


@compiled
def _add_both_by_loops(out: Array, share: float, values: Array) -> None:
    for i in range(len(values)):
        for j in range(len(values)):
            out[i, j] += share * (values[i, j] + values[j, i])


def _add_both_by_numpy(out: Array, share: float, values: Array) -> None:
    out += share * (values + values.T)


@compiled
def _put_mean_by_loops(out: Array, values: Array, diagonal: float) -> None:
    for i in range(len(out)):
        for j in range(len(out)):
            out[i, j] = 0.5 * (values[i, j] + values[j, i])
        out[i, i] *= diagonal


def _put_mean_by_numpy(out: Array, values: Array, diagonal: float) -> None:
    np.add(values, values.T, out)
    out *= 0.5
    out.ravel()[::len(out) + 1] *= diagonal


@compiled
def _scaled_by_loops(matrix: Array, row: Array) -> Array:
    found = np.empty_like(matrix)
    for i in range(len(matrix)):
        for j in range(row.size):
            found[i, j] = matrix[i, j] * row[j]
    return found


@compiled
def _row_products_by_loops(a: Array, b: Array) -> Array:
    found = np.zeros(len(a))
    for i in range(len(a)):
        for j in range(a.shape[1]):
            found[i] += a[i, j] * b[i, j]
    return found


def _row_products_by_numpy(a: Array, b: Array) -> Array:
    return np.asarray((a * b).sum(1))


@compiled
def _numbers_by_loops(values: Array) -> Array:
    return values


def _numbers_by_numpy(values: Array) -> Numbers:
    found: list[float] = values.tolist()
    return found


@compiled
def _logarithms_by_loops(matrix: Array) -> float:
    total = 0.0
    for i in range(len(matrix)):
        total += np.log(matrix[i, i])
    return total


def _logarithms_by_numpy(matrix: Array) -> float:
    return float(np.log(matrix.diagonal()).sum())


# In this order: out = v; out = A; out += c v; out += c A; one column of out += c v; out += x y';
# the diagonal of out += v; out += c (A + A'); out = (A + A') / 2 with its diagonal multiplied.
# The last four return A diag(v), the product of each row of A with that of B, the sum of ln A_ii,
# and numbers to read one by one: Python's own are three times quicker than those of an array.
put = _put_by_loops if COMPILED else np.copyto
put_matrix = _put_matrix_by_loops if COMPILED else np.copyto
add = _add_by_loops if COMPILED else _add_by_numpy
add_matrix = _add_matrix_by_loops if COMPILED else _add_by_numpy
add_column = _add_column_by_loops if COMPILED else _add_column_by_numpy
add_outer = _add_outer_by_loops if COMPILED else _add_outer_by_numpy
add_diagonal = _add_diagonal_by_loops if COMPILED else _add_diagonal_by_numpy
add_both = _add_both_by_loops if COMPILED else _add_both_by_numpy
put_mean = _put_mean_by_loops if COMPILED else _put_mean_by_numpy
scaled = _scaled_by_loops if COMPILED else np.multiply
row_products = _row_products_by_loops if COMPILED else _row_products_by_numpy
logarithms = _logarithms_by_loops if COMPILED else _logarithms_by_numpy
numbers = _numbers_by_loops if COMPILED else _numbers_by_numpy
