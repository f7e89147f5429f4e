"""The forces of `bending.py` for one arm at one instant, compiled where Numba is installed."""

from __future__ import annotations

from typing import Any

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
from flex_plant_sim.effects.mechanics.bending import (
    BendingTerms,
    field_factors,
    momentum_factors,
    remaining,
)
import numpy as np

_momentum_factors, _field_factors = compiled(momentum_factors), compiled(field_factors)
_remaining = compiled(remaining)


@compiled
def scalars(terms: BendingTerms, state: Array) -> tuple[Any, ...]:
    """Return rate, bent and short of momentum_factors, and the products with p and p'."""
    n, upper = len(terms.upper), terms.upper
    position, velocity = state[:n], state[n:2 * n]
    over_p, over_v = np.dot(terms.over_position, position), np.dot(terms.over_velocity, velocity)
    p, beta, dp, dbeta, c_1, c_2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        shorter, spun = over_p[3 + i], over_p[3 + n + i]
        if upper[i] > 0.0:
            p += 0.5 * position[i] * shorter
            dp += velocity[i] * shorter
            c_1 += position[i] * spun
        else:
            beta += 0.5 * position[i] * shorter
            dbeta += velocity[i] * shorter
            c_2 += position[i] * spun
    return ((over_v[0], over_v[1], over_v[2], over_v[3]),
            (over_p[0], over_p[1], np.sin(over_p[2]), np.cos(over_p[2])),
            (p, dp, c_1, beta, dbeta, c_2), over_p, over_v)


@compiled
def momentum(terms: BendingTerms, state: Array) -> Array:
    """Return dL/dp' of the energy of second order at a state, (N,)."""
    n, rows = len(terms.upper), terms.over_velocity
    rate, bent, short, over_p, _ = scalars(terms, state)
    f, left = _momentum_factors(rate, bent, short, terms.carried), _remaining(short, terms.most)
    found = np.empty(n)
    for i in range(n):
        by = f[4] if terms.upper[i] > 0.0 else f[5]
        found[i] = left * (by * over_p[3 + i] + f[0] * rows[0, i] + f[1] * rows[1, i]
                           + f[2] * rows[2, i] + f[3] * rows[3, i])
    return found


@compiled
def slopes(terms: BendingTerms, state: Array) -> Array:
    """Return its dL/dp, and what M(eta) has beyond CoriolisCentripetal, (N,)."""
    n, rows, turning = len(terms.upper), terms.over_position, terms.over_velocity
    rate, bent, short, over_p, over_v = scalars(terms, state)
    f, left = _field_factors(rate, bent, short, terms.carried), _remaining(short, terms.most)
    found = np.empty(n)
    for i in range(n):
        found[i] = (f[0] * rows[0, i] + f[1] * rows[1, i] + f[2] * rows[2, i]
                    + f[5] * turning[2, i] + f[6] * turning[3, i])
        shorter, spun, turned = over_p[3 + i], over_p[3 + n + i], bent[2] * over_v[4 + i]
        if terms.upper[i] > 0.0:
            found[i] += f[3] * shorter + rate[3] * turned + rate[0]**2 * spun
        else:
            found[i] += f[4] * shorter - rate[2] * turned + rate[1]**2 * spun
        found[i] *= left
    return found


def step_force(terms: BendingTerms, position: Array, velocity: Array, change: Array, step: float
               ) -> Array:
    """Return bending_force of one arm at one instant, (N,)."""
    middle = np.concatenate([position, velocity])
    gained = momentum(terms, middle + 0.5 * change) - momentum(terms, middle - 0.5 * change)
    return np.asarray(slopes(terms, middle) - gained / step)
