"""Cubic Hermite Euler-Bernoulli beam elements (textbook finite elements, e.g. Cook et al.)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Four Gauss points: exact up to degree 7, enough for products of cubic shapes.
GAUSS_POINTS, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(4)


def element_mass(mass_per_length: float, h: float) -> Array:
    """Return the consistent mass matrix (4, 4) of one element of length `h` m, kg."""
    return mass_per_length * h / 420.0 * np.array([
        [156.0, 22.0 * h, 54.0, -13.0 * h],
        [22.0 * h, 4.0 * h**2, 13.0 * h, -3.0 * h**2],
        [54.0, 13.0 * h, 156.0, -22.0 * h],
        [-13.0 * h, -3.0 * h**2, -22.0 * h, 4.0 * h**2]])


def element_stiffness(bending_stiffness: float, h: float) -> Array:
    """Return the stiffness matrix (4, 4) of one element, `bending_stiffness` EI in N m^2."""
    return bending_stiffness / h**3 * np.array([
        [12.0, 6.0 * h, -12.0, 6.0 * h],
        [6.0 * h, 4.0 * h**2, -6.0 * h, 2.0 * h**2],
        [-12.0, -6.0 * h, 12.0, -6.0 * h],
        [6.0 * h, 2.0 * h**2, -6.0 * h, 4.0 * h**2]])


def hermite(s: float, h: float, derivative: int = 0) -> Array:
    """Return the four cubic Hermite shapes (4,) at the local coordinate `s` in [0, 1]."""
    if derivative == 0:
        return np.array([1 - 3 * s**2 + 2 * s**3, h * (s - 2 * s**2 + s**3),
                         3 * s**2 - 2 * s**3, h * (s**3 - s**2)])
    if derivative == 1:
        return np.array([(6 * s**2 - 6 * s) / h, 1 - 4 * s + 3 * s**2,
                         (6 * s - 6 * s**2) / h, 3 * s**2 - 2 * s])
    return np.array([(12 * s - 6) / h**2, (6 * s - 4) / h,
                     (6 - 12 * s) / h**2, (6 * s - 2) / h])


@dataclass(frozen=True)
class BeamMesh:
    """
    A uniform beam of `elements` equal elements; node k has degrees 2k (w, m), 2k+1 (w', rad).

    Attributes: length m, mass_per_length kg/m, bending_stiffness N m^2.
    """

    length: float
    mass_per_length: float
    bending_stiffness: float
    elements: int = 20

    @property
    def size(self) -> int:
        """Number of degrees of freedom, root included."""
        return 2 * (self.elements + 1)

    @property
    def element_length(self) -> float:
        """Length of one element, m."""
        return self.length / self.elements

    def mass(self) -> Array:
        """Return the mass matrix (size, size), kg."""
        return self._assemble(element_mass(self.mass_per_length, self.element_length))

    def stiffness(self) -> Array:
        """Return the stiffness matrix (size, size), N/m."""
        return self._assemble(element_stiffness(self.bending_stiffness, self.element_length))

    def _assemble(self, element: Array) -> Array:
        total = np.zeros((self.size, self.size))
        for k in range(self.elements):
            total[2 * k:2 * k + 4, 2 * k:2 * k + 4] += element
        return total

    def row(self, x: float, derivative: int = 0) -> Array:
        """
        Return the map from nodal values to w, w' or w'' at `x` m from the root, (size,).

        The curvature of the elements jumps at a node; there the mean of both sides is returned.
        """
        h = self.element_length
        position = x / h
        nearest = round(position)
        if derivative == 2 and abs(position - nearest) < 1e-9 and 0 < nearest < self.elements:
            return 0.5 * (self._row(nearest - 1, 1.0, 2) + self._row(nearest, 0.0, 2))
        k = min(int(position), self.elements - 1)
        return self._row(k, position - k, derivative)

    def _row(self, element: int, s: float, derivative: int) -> Array:
        row = np.zeros(self.size)
        row[2 * element:2 * element + 4] = hermite(s, self.element_length, derivative)
        return row

    def quadrature(self) -> tuple[Array, Array, Array, Array]:
        """Return positions (q,) m, weights (q,) m, and rows (q, size) of w and of w'."""
        h = self.element_length
        x, weight, rows, slopes = [], [], [], []
        for k in range(self.elements):
            for point, gauss_weight in zip(GAUSS_POINTS, GAUSS_WEIGHTS):
                s = 0.5 * (point + 1.0)
                x.append((k + s) * h)
                weight.append(0.5 * h * gauss_weight)
                rows.append(self._row(k, s, 0))
                slopes.append(self._row(k, s, 1))
        return np.array(x), np.array(weight), np.array(rows), np.array(slopes)
