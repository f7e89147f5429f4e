"""
Ritz shapes of a clamped beam: static tip-load shapes completed by clamped-pinned modes.

The assumed-modes arm model bends its links in these shapes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from flex_plant_sim.arm.beam import Array, Beam
import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_triangular


@dataclass(frozen=True)
class RitzShapes:
    """
    n shapes that diagonalise the mass and the stiffness of the clamped beam.

    The clamped-free modes have no moment and no shear at the tip, where the lower link and the
    payload act; a sum of them converges slowly there. The static deflections under a tip force
    and under a tip moment represent both exactly. The bending that remains, with the tip at
    rest, is described by the modes with a pinned tip (component mode synthesis with a fixed
    interface: Craig and Bampton, AIAA Journal 6, 1968), since the load at the tip hardly moves in
    the higher modes of the arm. A few shapes therefore suffice. The modal mass is mu = m/4.

    Attributes
    ----------
    beam : Beam
        The beam with its n clamped-free modes.
    coefficients : Array
        Shape k is sum_j candidate_j coefficients[j, k], with the candidates of `_candidates`;
        shape (n, n).
    frequencies : Array
        rad/s, ascending, shape (n,).
    moments : tuple of Array
        int phi_i d(x/L) and int (x/L) phi_i d(x/L), shape (n,) each.

    """

    beam: Beam
    coefficients: Array
    frequencies: Array

    moments: tuple[Array, Array]

    @classmethod
    def of(cls, beam: Beam) -> RitzShapes:
        """Return the Ritz shapes of a beam, as many as it has modes."""
        coefficients, frequencies, moments = _dimensionless_shapes(beam.roots.size)
        scale = np.sqrt(beam.bending_stiffness / beam.mass_per_length) / beam.length**2
        return cls(beam, coefficients, scale * frequencies, moments)

    @property
    def modal_mass(self) -> float:
        """Return mu, kg, the same for every shape."""
        return self.beam.modal_mass

    @property
    def alpha(self) -> Array:
        """Return -(4/L) int x phi_i dx, m, shape (n,)."""
        return -4.0 * self.beam.length * self.moments[1]

    @property
    def beta(self) -> Array:
        """Return -(4/L) int phi_i dx, shape (n,)."""
        return -4.0 * self.moments[0]

    def shape(self, x: ArrayLike, derivative: int = 0) -> Array:
        """Return phi_i(x) or a derivative (0 to 3), shape x.shape + (n,)."""
        points = np.asarray(x, dtype=float)
        known = _cached_candidates(self.beam.length, self.beam.roots.size,
                                   tuple(points.ravel().tolist()), derivative)
        return known.reshape(points.shape + known.shape[1:]) @ self.coefficients


@lru_cache(maxsize=32)
def _dimensionless_shapes(n: int) -> tuple[Array, Array, tuple[Array, Array]]:
    """
    Return coefficients, frequencies and moments of order 0 and 1 for L = rho a = E I = 1.

    The shapes over x/L do not depend on the dimensions, so they are computed once for each n.
    """
    beam = Beam.with_modes(1.0, 1.0, 1.0, n)
    x, w = _quadrature(beam)
    root = np.sqrt(w)[:, None]
    # The candidates are nearly dependent (condition 1e7 for n = 20). Working with the factors of
    # the mass and stiffness matrices, not with the matrices, keeps half of the digits.
    factor = np.linalg.qr(root * _candidates(beam, x, 0), mode='r')
    bend = solve_triangular(factor, (root * _candidates(beam, x, 2)).T, trans='T')
    directions, frequencies, _ = np.linalg.svd(bend, full_matrices=False)
    vectors = solve_triangular(factor, directions[:, ::-1]) * np.sqrt(beam.modal_mass)
    tip = _candidates(beam, np.array(1.0), 0) @ vectors
    vectors = vectors * np.where(tip < 0.0, -1.0, 1.0) * (-1.0)**np.arange(n)
    values = _candidates(beam, x, 0) @ vectors
    return vectors, frequencies[::-1].copy(), (w @ values, (w * x) @ values)


def _quadrature(beam: Beam) -> tuple[Array, Array]:
    """Return Gauss-Legendre points and weights that integrate products of the shapes exactly."""
    points, weights = np.polynomial.legendre.leggauss(40 + 4 * beam.roots.size)
    return 0.5 * beam.length * (points + 1.0), 0.5 * beam.length * weights


@lru_cache(maxsize=256)
def _cached_candidates(length: float, count: int, x: tuple[float, ...], derivative: int) -> Array:
    """Return `_candidates`, cached: many arms that differ in other parts have equal lengths."""
    beam = Beam.with_modes(length, 1.0, 1.0, count)
    return _candidates(beam, np.array(x), derivative)


def _candidates(beam: Beam, x: Array, derivative: int) -> Array:
    """
    Return the first n of the candidate shapes, or a derivative, shape x.shape + (n,).

    They are the deflections under a tip force and a tip moment, then the clamped-pinned modes.
    """
    length, count = beam.length, beam.roots.size
    force = np.polynomial.Polynomial([0.0, 0.0, 1.5 / length**2, -0.5 / length**3])
    moment = np.polynomial.Polynomial([0.0, 0.0, 1.0 / length**2])
    static = np.stack([force.deriv(derivative)(x) * np.ones_like(x),
                       moment.deriv(derivative)(x) * np.ones_like(x)], axis=-1)
    modes = _clamped_pinned(x / length, max(count - 2, 0), derivative) / length**derivative
    return np.concatenate([static[..., :count], modes], axis=-1)


def _clamped_pinned(x: Array, count: int, derivative: int) -> Array:
    """
    Return sinh(g (1 - x)) / sinh g - sin(g (1 - x)) / sin g or a derivative, x.shape + (count,).

    Clamped at 0, pinned at 1, where tan g = tanh g (Blevins 1979, table 8-1).
    """
    roots = (np.arange(count) + 1.25) * np.pi
    for _ in range(3):
        # Each iteration reduces the error to less than e^(-2 g) < 4e-4 of it.
        roots = (np.arange(count) + 1.0) * np.pi + np.arctan(np.tanh(roots))
    z, parity = np.multiply.outer(x, roots), (-1.0)**derivative
    # Only decaying exponentials are used, so that high modes keep their digits.
    hyperbolic = (parity * np.exp(-z) - np.exp(z - 2.0 * roots)) / -np.expm1(-2.0 * roots)
    sine = parity * np.sin(roots - z + 0.5 * np.pi * derivative) / np.sin(roots)
    return np.asarray(roots**derivative * (hyperbolic - sine))
