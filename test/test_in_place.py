"""Sums in place, as they are compiled and as NumPy has them, against their definitions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from flex_payload_estimator.kalman import in_place
from flex_plant_sim.arm.second_order import Array
import numpy as np
import pytest

FORMS = {
    'add': lambda out, v, w, a: (out[:, 0], (0.3, v)),
    'add_matrix': lambda out, v, w, a: (out, (0.3, a)),
    'add_column': lambda out, v, w, a: (out, (1, 0.3, v)),
    'add_outer': lambda out, v, w, a: (out, (v, w)),
    'add_diagonal': lambda out, v, w, a: (out, (v,)),
    'add_both': lambda out, v, w, a: (out, (0.3, a)),
    'put_mean': lambda out, v, w, a: (out, (a, 1.5)),
}
N = 4


def entry(name: str, i: int, j: int, old: float, v: Array, w: Array, a: Array) -> float:
    """Return what an entry of `out` becomes."""
    return {'add': old + (0.3 * v[i] if j == 0 else 0.0),
            'add_matrix': old + 0.3 * a[i, j],
            'add_column': old + (0.3 * v[i] if j == 1 else 0.0),
            'add_outer': old + v[i] * w[j],
            'add_diagonal': old + (v[i] if i == j else 0.0),
            'add_both': old + 0.3 * (a[i, j] + a[j, i]),
            'put_mean': (a[i, j] + a[j, i]) * (0.75 if i == j else 0.5)}[name]


@pytest.mark.parametrize('name', FORMS)
def test_an_entry_becomes_what_the_name_says(name: str) -> None:
    random = np.random.default_rng(3)
    v, w = random.standard_normal((2, N))
    a, out = random.standard_normal((2, N, N))
    expected = [[entry(name, i, j, float(out[i, j]), v, w, a) for j in range(N)]
                for i in range(N)]
    for function in forms(name):
        found = out.copy()
        target, given = FORMS[name](found, v, w, a)
        function(target, *given)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-15)


def test_products_of_rows_and_logarithms_of_a_diagonal() -> None:
    random = np.random.default_rng(4)
    a, b = random.uniform(0.5, 2.0, (2, 3, 3))
    row = np.array([2.0, -1.0, 0.5])
    for function in forms('scaled'):
        assert function(a, row)[1] == pytest.approx([2.0 * a[1, 0], -a[1, 1], 0.5 * a[1, 2]])
    for function in forms('row_products'):
        assert function(a, b)[2] == pytest.approx(sum(x * y for x, y in zip(a[2], b[2])))
    for function in forms('logarithms'):
        assert function(a) == pytest.approx(np.log(a[0, 0] * a[1, 1] * a[2, 2]))


def forms(name: str) -> list[Callable[..., Any]]:
    """Return a function in use, and its form without Numba where it has one of its own."""
    found = [getattr(in_place, name)]
    if hasattr(in_place, f'_{name}_by_numpy'):
        found.append(getattr(in_place, f'_{name}_by_numpy'))
    return found
