"""Derivatives of the factors in bending.py with respect to their scalars, for linearisation."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
import numpy as np

# Number of scalars: w_1, w_2, epsilon, sigma, tau, alpha, eta, P, P', C_1, beta, beta', C_2.
SCALARS = 13


@compiled
def momentum_derivatives(z: Array, carried: float) -> Array:
    """
    Return the derivatives of `momentum_factors`, (6, SCALARS).

    Parameters
    ----------
    z : Array
        The scalars, (SCALARS,).
    carried : float
        M_2, kg.

    """
    w_1, w_2, epsilon, sigma, tau, alpha, eta, p, dp, c_1, beta, dbeta, c_2 = z
    s, c, found = np.sin(eta), np.cos(eta), np.zeros((6, SCALARS))
    # The first four are derivatives of the energy, so their own derivatives are symmetric.
    found[0, 0], found[1, 1] = carried * tau * tau + c_1, c_2
    found[0, 1] = found[1, 0] = c * tau * alpha
    found[0, 2] = found[2, 0] = -carried * p
    found[0, 3] = found[3, 0] = s * tau - c * p
    found[1, 2] = found[2, 1] = -s * alpha - c * beta
    found[0, 4] = 2.0 * carried * w_1 * tau + c * w_2 * alpha + s * sigma
    found[1, 4], found[3, 4] = c * w_1 * alpha, s * w_1
    found[0, 5], found[1, 5], found[2, 5] = c * w_2 * tau, c * w_1 * tau - s * epsilon, -s * w_2
    found[0, 6] = c * tau * sigma - s * (w_2 * tau * alpha - p * sigma)
    found[1, 6] = -c * epsilon * alpha - s * (w_1 * tau * alpha - epsilon * beta)
    found[2, 6] = s * w_2 * beta - c * (w_2 * alpha + dbeta)
    found[3, 6] = c * (w_1 * tau + dp) + s * w_1 * p
    found[0, 7], found[2, 7], found[3, 7] = (-carried * epsilon - c * sigma, -carried * w_1,
                                             -c * w_1)
    found[0, 9], found[1, 10], found[2, 10] = w_1, -c * epsilon, -c * w_2
    found[3, 8], found[2, 11], found[1, 12] = s, -s, w_2
    found[4, 3], found[4, 6], found[5, 2], found[5, 6] = s, c * sigma, -s, -c * epsilon
    return found


@compiled
def field_derivatives(z: Array, carried: float) -> Array:
    """Return the derivatives of `field_factors`, (7, SCALARS); see momentum_derivatives."""
    w_1, w_2, epsilon, sigma, tau, alpha, eta, p, dp, _, beta, dbeta, _ = z
    s, c, found = np.sin(eta), np.cos(eta), np.zeros((7, SCALARS))
    # Factors of cos eta and of -sin eta in the third.
    even = (w_1 * tau + dp) * sigma - epsilon * (w_2 * alpha + dbeta)
    odd = w_1 * w_2 * tau * alpha - w_1 * p * sigma - epsilon * w_2 * beta + epsilon * sigma
    found[0, 0] = 2.0 * carried * w_1 * tau + s * sigma + c * w_2 * alpha
    found[0, 1], found[0, 3] = c * w_1 * alpha, s * w_1
    found[0, 4], found[0, 5] = carried * w_1 * w_1, c * w_1 * w_2
    found[0, 6] = c * w_1 * sigma - s * w_1 * w_2 * alpha
    found[1, 0], found[1, 1], found[1, 2] = c * w_2 * tau, c * w_1 * tau - s * epsilon, -s * w_2
    found[1, 4], found[1, 6] = c * w_1 * w_2, -c * epsilon * w_2 - s * w_1 * w_2 * tau
    found[2, 0] = c * tau * sigma - s * (w_2 * tau * alpha - p * sigma)
    found[2, 1] = -c * epsilon * alpha - s * (w_1 * tau * alpha - epsilon * beta)
    found[2, 2] = -c * (w_2 * alpha + dbeta) - s * (sigma - w_2 * beta)
    found[2, 3] = c * (w_1 * tau + dp) - s * (epsilon - w_1 * p)
    found[2, 4], found[2, 5] = found[0, 6], found[1, 6]
    found[2, 6] = -s * even - c * odd
    found[2, 7], found[2, 8] = s * w_1 * sigma, c * sigma
    found[2, 10], found[2, 11] = s * epsilon * w_2, -c * epsilon
    found[3, 0], found[3, 2], found[3, 3] = (-carried * epsilon - c * sigma, -carried * w_1,
                                             -c * w_1)
    found[3, 6], found[4, 6] = s * w_1 * sigma, s * epsilon * w_2
    found[4, 1], found[4, 2] = -c * epsilon, -c * w_2
    found[5, 0], found[5, 3], found[5, 6] = -s * sigma, -s * w_1, -c * w_1 * sigma
    found[6, 1], found[6, 2], found[6, 6] = s * epsilon, s * w_2, c * w_2 * epsilon
    return found
