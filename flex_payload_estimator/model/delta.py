"""Delta model (19)-(22): Omega, and how well it keeps its digits where the shift form fails."""

from __future__ import annotations

from functools import lru_cache
import math

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
from msg_config.errors import InputError
import numpy as np

# Powers that are made: the root of the 16 terms asks the fewest products (Paterson, Stockmeyer).
BLOCK = 4
# Of Omega: what the terms that are left out of (19) may come to.
TRUNCATION = 1e-12


@lru_cache(maxsize=32)
def _coefficients(terms: int) -> Array:
    """Return 1/(i+1)! for i = 0…terms in rows of BLOCK, zero-padded."""
    values = [1.0 / math.factorial(i + 1) for i in range(terms + 1)]
    values += [0.0] * (-len(values) % BLOCK)
    return np.array(values).reshape(-1, BLOCK)


def omega(a: Array, step: float, terms: int = 15, halvings: int = 0) -> Array:
    """
    Return Omega = I + sum_{i=1}^{n'} (A h)^i / (i+1)!, (19), doubled back from h to T.

    The sum is Horner's in blocks of four powers (Paterson and Stockmeyer): n' = 15 costs six
    products. Doubling stays in the delta domain, Omega(2h) = Omega(h) (I + h/2 A Omega(h)),
    and never forms I + T A.

    Parameters
    ----------
    a : Array
        A, (n, n), 1/s.
    step : float
        T, s.
    terms : int
        n' >= 1.
    halvings : int
        h = T / 2^halvings; 0 is (19) as printed.

    Raises
    ------
    InputError
        terms < 1 or halvings < 0.

    """
    return DeltaOperator(len(a), step, terms, halvings)(a)


class DeltaOperator:
    """
    Omega for many matrices of one size: (19) without allocating what it works in.

    Parameters
    ----------
    size : int
        n.
    step : float
        T, s.
    terms, halvings : int
        As in `omega`.

    Attributes
    ----------
    room : tuple
        What `series` takes after A.

    """

    def __init__(self, size: int, step: float, terms: int = 15, halvings: int = 0):
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
def series(a: Array, first: float, coefficients: Array, powers: Array, fourth: Array,
           halvings: int) -> Array:
    """Return Omega of A; powers (BLOCK, n, n) begins with I, the rest is room to work in."""
    x, square = powers[1], powers[2]
    np.multiply(a, first, x)
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


def halvings_for(spectral_radius: float, step: float, terms: int = 15) -> int:
    """
    Return how often to halve T so that the first term left out of (19) is below 1e-12.

    The spectral radius of A (1/s) is taken, not a norm: A mixes units, so that its norm says
    little about the size of A^i T^i.
    """
    size, halvings = spectral_radius * step, 0
    log_limit = math.log(TRUNCATION) + math.lgamma(terms + 3)
    while size > 0.0 and (terms + 1) * math.log(size) > log_limit:
        size, halvings = 0.5 * size, halvings + 1
    return halvings


def delta_model(a: Array, b: Array, step: float, terms: int = 15,
                halvings: int = 0) -> tuple[Array, Array]:
    """Return A-bar = Omega A (n, n) and B-bar = Omega B (n, m), (20), (21)."""
    big = omega(a, step, terms, halvings)
    return big.dot(a), big.dot(b)


def shift_round_trip(a: Array, step: float, halvings: int = 0) -> Array:
    """Return (F - I) / T with F = I + T A-bar rounded to double: what the shift form keeps."""
    a_bar, _ = delta_model(a, a, step, halvings=halvings)
    identity = np.eye(len(a))
    return ((identity + step * a_bar) - identity) / step


def digits_over_step(a: Array, steps: Array, spectral_radius: float) -> tuple[Array, Array]:
    """
    Return the relative errors of A-bar in delta and in shift form, each of steps.shape.

    Errors are those of the diagonal, where F has 1 + T a and rounds a away, over its largest
    entry. The reference is (19) with 40 terms in extended precision.
    """
    delta, shift = [], []
    for step in steps:
        exact = np.diagonal(_extended(a, float(step), spectral_radius))
        halvings = halvings_for(spectral_radius, float(step))
        scale = float(np.max(np.abs(exact)))
        a_bar, _ = delta_model(a, a, float(step), halvings=halvings)
        back = shift_round_trip(a, float(step), halvings=halvings)
        delta.append(float(np.max(np.abs(np.diagonal(a_bar) - exact))) / scale)
        shift.append(float(np.max(np.abs(np.diagonal(back) - exact))) / scale)
    return np.array(delta), np.array(shift)


def _extended(a: Array, step: float, spectral_radius: float) -> np.ndarray:
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
