"""
The zero of joint 2's angle sensor: it reads theta_2 + b, and b is a parameter.

The arm's matrices depend on cos theta_2 alone, so that a wrong zero is a wrong arm. Joint 1 turns
the whole arm, which changes nothing in a horizontal plane: its zero is no parameter.
"""

from __future__ import annotations

import math

from flex_payload_estimator.estimators.rpe.filter import Filter
from flex_payload_estimator.estimators.rpe.time_update import FIRST_BIAS
from flex_plant_sim.arm.second_order import Array
import numpy as np

# Variance of a zero of which nothing is known, rad^2: a uniform law on the circle.
ANYWHERE = math.pi**2 / 3.0


def zero_column(channels: int) -> int:
    """Return the zero's column in beta, after the gauges' biases, for m channels."""
    return FIRST_BIAS + channels - 2


def slip(f: Filter) -> None:
    """
    Let the zero slip to anywhere; the state stays, and f changes in place.

    With z the zero's column, q the variance of a slip, r the row of V^-1 and a = q / (1 + q r_z):
    P <- P + a s_z s_z', s <- s - a s_z r, V_zz <- V_zz + q, as time_update.walk.
    """
    z, state = zero_column(f.sizes[2]), f.state
    row = np.linalg.solve(f.beta_cov, np.eye(len(f.beta_cov))[z])
    column = f.sensitivity[:, z].copy()
    moved = ANYWHERE / (1.0 + ANYWHERE * row[z]) * column
    f.cov += np.outer(moved, column)
    f.sensitivity -= np.outer(moved, row)
    f.beta_cov[z, z] += ANYWHERE
    f.x += state - f.state


def reading_sensitivity(f: Filter) -> Array:
    """
    Return the derivative of the state over beta with theta_2's reading for theta_2, (n, B).

    A filter whose zero begins at its prior knows the reading theta_2 + b as well as f did, and
    theta_2 no better than that zero.
    """
    found = f.sensitivity.copy()
    found[1, zero_column(f.sizes[2])] += 1.0
    return found
