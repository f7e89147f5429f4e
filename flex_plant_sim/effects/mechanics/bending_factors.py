"""What the energy of `bending.py` gives of its scalars, for arrays and for compiled loops."""

from __future__ import annotations

from typing import Any

from flex_plant_sim.compiled import compiled

# Power of the shortening in the factor by which forces fade, see FADE_SHORTENING in bending.py.
FADE_EXPONENT = 8


def remaining(short: Any, most: tuple[float, float]) -> Any:
    """Return the factor, from 1 to 0, by which the forces fade at large deflections."""
    return 1.0 / (1.0 + (short[0] / most[0])**FADE_EXPONENT + (short[3] / most[1])**FADE_EXPONENT)


def momentum_factors(rate: Any, bent: Any, short: Any, carried: float) -> tuple[Any, ...]:
    """
    Return the momenta conjugate to w_1, w_2, epsilon, sigma, P' and beta'.

    Parameters
    ----------
    rate : tuple
        w_1, w_2, epsilon, sigma.
    bent : tuple
        tau, alpha, sin and cos of eta.
    short : tuple
        P, P', C_1, beta, beta', C_2.
    carried : float
        M_2, kg.

    """
    w_1, w_2, epsilon, sigma = rate
    tau, alpha, s, c = bent
    p, dp, c_1, beta, dbeta, c_2 = short
    return (carried * (w_1 * tau * tau - epsilon * p) + w_1 * c_1
            + c * (w_2 * tau * alpha - p * sigma) + s * tau * sigma,
            w_2 * c_2 - s * epsilon * alpha + c * (w_1 * tau * alpha - epsilon * beta),
            -carried * w_1 * p - s * (w_2 * alpha + dbeta) - c * w_2 * beta,
            s * (w_1 * tau + dp) - c * w_1 * p,
            s * sigma, -s * epsilon)


def field_factors(rate: Any, bent: Any, short: Any, carried: float) -> tuple[Any, ...]:
    """
    Return the energy's derivatives with respect to tau, alpha, eta, P and beta.

    They are followed by the forces of M(eta) that CoriolisCentripetal does not have, along
    epsilon and sigma; their part along eta is in the third value. The parameters are those of
    momentum_factors.
    """
    w_1, w_2, epsilon, sigma = rate
    tau, alpha, s, c = bent
    p, dp, _, beta, dbeta, _ = short
    return (carried * w_1 * w_1 * tau + s * w_1 * sigma + c * w_1 * w_2 * alpha,
            -s * epsilon * w_2 + c * w_1 * w_2 * tau,
            c * ((w_1 * tau + dp) * sigma - epsilon * (w_2 * alpha + dbeta))
            - s * (w_1 * w_2 * tau * alpha - w_1 * p * sigma - epsilon * w_2 * beta
                   + epsilon * sigma),
            -carried * epsilon * w_1 - c * w_1 * sigma, -c * epsilon * w_2,
            -s * w_1 * sigma, s * w_2 * epsilon)


compiled_momentum_factors = compiled(momentum_factors)
compiled_field_factors = compiled(field_factors)
compiled_remaining = compiled(remaining)
