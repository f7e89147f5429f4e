"""
The delta model (19)-(22): Omega, A-bar and B-bar from the continuous A and B.

The Kalman predictors, SF1 and the LQG controller take their sampled model from here.
`digits_over_step` compares the rounding errors of the delta form with those of the shift form.
"""

from __future__ import annotations

from functools import lru_cache
import math

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
from msg_config.errors import InputError
import numpy as np

# Powers of A h per block of Horner's scheme: the square root of the 16 terms needs the fewest
# matrix products (Paterson, Stockmeyer).
BLOCK = 4
# Largest first term of (19) that may be left out of Omega, dimensionless.
TRUNCATION = 1e-12
# n' of (19) in (30), and wherever none is given.
TERMS = 15


@lru_cache(maxsize=32)
def _coefficients(terms: int) -> Array:
    """Return 1/(i+1)! for i = 0…terms, zero-padded, in rows of BLOCK."""
    values = [1.0 / math.factorial(i + 1) for i in range(terms + 1)]
    values += [0.0] * (-len(values) % BLOCK)
    return np.array(values).reshape(-1, BLOCK)


def omega(a: Array, step: float, terms: int, halvings: int = 0) -> Array:
    """
    Return Omega = I + sum_{i=1}^{n'} (A h)^i / (i+1)!, (19), doubled from h up to T.

    The sum is evaluated by Horner's scheme in blocks of four powers (Paterson and Stockmeyer):
    n' = 15 costs six matrix products. Doubling stays in the delta domain, Omega(2h) = Omega(h)
    (I + h/2 A Omega(h)), and never forms I + T A, which would round A away.

    Parameters
    ----------
    a : Array
        A, (n, n), 1/s.
    step : float
        T, s.
    terms : int
        n' >= 1.
    halvings : int
        h = T / 2^halvings; 0 gives (19) as printed.

    Raises
    ------
    InputError
        terms < 1 or halvings < 0.

    """
    return DeltaOperator(len(a), step, terms, halvings)(a)


class DeltaOperator:
    """
    Omega (19) for many matrices of one size, in work arrays that are allocated once.

    Parameters
    ----------
    size : int
        n, the number of states.
    step : float
        T, s.
    terms, halvings : int
        As in `omega`.

    Attributes
    ----------
    room : tuple
        Step, coefficients and work arrays: the arguments of `series` after A.

    """

    def __init__(self, size: int, step: float, terms: int, halvings: int):
        if terms < 1 or halvings < 0:
            raise InputError(f"omega: expected n' >= 1 and halvings >= 0, got {terms} "
                             f'and {halvings}')
        powers = np.empty((BLOCK, size, size))
        powers[0] = np.eye(size)
        self.room = (step / 2.0**halvings, _coefficients(terms), powers, np.empty((size, size)),
                     halvings)

    def __call__(self, a: Array) -> Array:
        """Return Omega of A, (n, n)."""
        return series(a, *self.room)


@compiled
def series(a: Array, substep: float, coefficients: Array, powers: Array, fourth: Array,
           halvings: int) -> Array:
    """
    Return Omega of A, (n, n): the compiled core of `omega`.

    Parameters
    ----------
    a : Array
        A, (n, n), 1/s.
    substep : float
        h = T / 2^halvings, s.
    coefficients : Array
        1/(i+1)!, in rows of BLOCK.
    powers : Array
        (BLOCK, n, n); begins with I, the powers of A h are written behind it.
    fourth : Array
        Work array for (A h)^4, (n, n).
    halvings : int
        How often h is doubled to reach T.

    """
    x, square = powers[1], powers[2]
    np.multiply(a, substep, x)
    np.dot(x, x, square)
    np.dot(square, x, powers[3])
    np.dot(square, square, fourth)
    size = len(a)
    blocks = np.dot(coefficients, powers.reshape(BLOCK, size * size))
    result = blocks[-1].reshape(size, size)
    for i in range(len(blocks) - 2, -1, -1):
        result = np.dot(result, fourth)
        result += blocks[i].reshape(size, size)
    x *= 0.5
    for _ in range(halvings):
        doubled = np.dot(result, np.dot(x, result))
        doubled += result
        result = doubled
        x *= 2.0
    return result


def halvings_for(spectral_radius: float, step: float, terms: int) -> int:
    """
    Return how often to halve T so that the first term left out of (19) is below 1e-12.

    The size of A is taken as its spectral radius (1/s) instead of a norm: A mixes units, so a
    norm says little about the size of A^i T^i.
    """
    size, halvings = spectral_radius * step, 0
    log_limit = math.log(TRUNCATION) + math.lgamma(terms + 3)
    while size > 0.0 and (terms + 1) * math.log(size) > log_limit:
        size, halvings = 0.5 * size, halvings + 1
    return halvings


def delta_model(a: Array, b: Array, step: float, halvings: int = 0) -> tuple[Array, Array]:
    """Return A-bar = Omega A (n, n), B-bar = Omega B (n, m), (20), (21), by TERMS terms."""
    factor = omega(a, step, TERMS, halvings)
    return factor.dot(a), factor.dot(b)


def shift_round_trip(a: Array, step: float, halvings: int = 0) -> Array:
    """Return A-bar as the shift form keeps it: (F - I) / T with F = I + T A-bar in double."""
    a_bar, _ = delta_model(a, a, step, halvings=halvings)
    identity = np.eye(len(a))
    return ((identity + step * a_bar) - identity) / step


def digits_over_step(a: Array, steps: Array, spectral_radius: float) -> tuple[Array, Array]:
    """
    Return the relative errors of A-bar in delta and in shift form, each of steps.shape.

    The error is the largest one on the diagonal, where F = 1 + T a rounds a away, divided by the
    diagonal's largest entry. The reference is (19) with 40 terms in extended precision.

    Parameters
    ----------
    a : Array
        A, (n, n), 1/s.
    steps : Array
        Sampling intervals T, s.
    spectral_radius : float
        Of A, 1/s.

    """
    delta, shift = [], []
    for step in steps:
        exact = np.diagonal(_a_bar_extended(a, float(step), spectral_radius))
        halvings = halvings_for(spectral_radius, float(step), TERMS)
        scale = float(np.max(np.abs(exact)))
        a_bar, _ = delta_model(a, a, float(step), halvings=halvings)
        back = shift_round_trip(a, float(step), halvings=halvings)
        delta.append(float(np.max(np.abs(np.diagonal(a_bar) - exact))) / scale)
        shift.append(float(np.max(np.abs(np.diagonal(back) - exact))) / scale)
    return np.array(delta), np.array(shift)


def _a_bar_extended(a: Array, step: float, spectral_radius: float) -> np.ndarray:
    """Return A-bar by (19) with 40 terms in extended precision, (n, n)."""
    halvings = halvings_for(spectral_radius, step, 40)
    wide = np.asarray(a, dtype=np.longdouble)
    scaled = wide * (np.longdouble(step) / 2**halvings)
    identity = np.eye(len(a), dtype=np.longdouble)
    result = identity
    for i in range(40, 0, -1):
        result = identity + scaled @ result / np.longdouble(i + 1)
    for _ in range(halvings):
        result = result + result @ (scaled @ result) / 2
        scaled = 2 * scaled
    return result @ wide
