"""
Clamped-free Euler-Bernoulli beam: frequency equation, mode shapes, modal constants (B, G, H).

The arm models take the bending of a link from here. B, G and H are the paper's appendices.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@lru_cache(maxsize=32)
def frequency_roots(n: int) -> Array:
    """
    Return the first n roots x = gamma L of cosh(x) cos(x) = -1, (41).

    Newton-Raphson on cos(x) + 1/cosh(x), started at (i - 1/2) pi (Appendix G). The second term
    is evaluated from exp(-x), so that it does not overflow for high modes.

    Returns
    -------
    Array
        Shape (n,), dimensionless.

    """
    x = np.linspace(0.5, n - 0.5, n) * np.pi
    for _ in range(20):
        sech = 2.0 * np.exp(-x) / (1.0 + np.exp(-2.0 * x))
        step = (np.cos(x) + sech) / (-np.sin(x) - sech * np.tanh(x))
        x = x - step
        if np.all(np.abs(step) <= 4e-16 * x):
            break
    return x


@dataclass(frozen=True)
class Beam:
    """
    A prismatic beam that bends in the direction of its thickness, with n clamped-free modes.

    Attributes
    ----------
    length : float
        L, m.
    mass_per_length : float
        rho a, kg/m.
    bending_stiffness : float
        E I, N m^2.
    roots : Array
        gamma_i L, shape (n,).

    """

    length: float
    mass_per_length: float
    bending_stiffness: float
    roots: Array

    @classmethod
    def with_modes(cls, length: float, mass_per_length: float,
                   bending_stiffness: float, n: int) -> Beam:
        """Return the beam of a length, m, kg/m and E I, N m^2, with its first n modes."""
        return cls(length, mass_per_length, bending_stiffness, frequency_roots(n))

    @property
    def mass(self) -> float:
        """Mass, kg."""
        return self.mass_per_length * self.length

    @property
    def modal_mass(self) -> float:
        """Return mu = rho a L / 4, kg: the modal mass for shapes scaled to phi(L) = +-1."""
        return self.mass / 4.0

    @property
    def wave_numbers(self) -> Array:
        """Return gamma_i, 1/m, shape (n,)."""
        return self.roots / self.length

    @property
    def frequencies(self) -> Array:
        """Return omega_i of the clamped-free beam, rad/s, shape (n,)."""
        return self.wave_numbers**2 * np.sqrt(self.bending_stiffness / self.mass_per_length)

    @property
    def beta(self) -> Array:
        """
        Return beta_i = -(4/L) int phi_i dx, (45), shape (n,).

        phi'''' = gamma^4 phi turns the integral into -phi'''(0) / gamma^4.
        """
        return 4.0 / self.length * self.shape(0.0, 3) / self.wave_numbers**4

    @property
    def alpha(self) -> Array:
        """
        Return alpha_i = -(4/L) int x phi_i dx, (44), m, shape (n,).

        phi'''' = gamma^4 phi turns the integral into phi''(0) / gamma^4.
        """
        return -4.0 / self.length * self.shape(0.0, 2) / self.wave_numbers**4

    def shape(self, x: ArrayLike, derivative: int = 0) -> Array:
        """
        Return phi_i(x) or a derivative, (38) with (40), scaled to phi_i(L) = +-1.

        The growing and the decaying exponential are evaluated separately, because cosh - sigma
        sinh would lose its digits by cancellation in high modes.

        Parameters
        ----------
        x : ArrayLike
            Distance from the clamp, m, any shape.
        derivative : int
            0 to 3.

        Returns
        -------
        Array
            Shape x.shape + (n,), in 1/m^derivative.

        """
        g = self.roots
        z = np.multiply.outer(np.asarray(x, dtype=float), self.wave_numbers)
        decay = np.exp(-g)
        scale = 1.0 + 2.0 * decay * np.sin(g) - decay**2
        growing = (np.sin(g) - np.cos(g) - decay) / scale
        one_minus_sigma = 2.0 * decay * growing
        sigma = 1.0 - one_minus_sigma
        parity = (-1.0)**derivative
        hyperbolic = growing * np.exp(z - g) + parity * 0.5 * (1.0 + sigma) * np.exp(-z)
        quarter = 0.5 * np.pi * derivative
        trigonometric = -np.cos(z + quarter) + sigma * np.sin(z + quarter)
        return 0.5 * self.wave_numbers**derivative * (hyperbolic + trigonometric)
