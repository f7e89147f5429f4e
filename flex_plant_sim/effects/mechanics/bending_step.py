"""The forces of `bending.py` arm by arm, compiled where Numba is installed."""

from __future__ import annotations

from typing import Any

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
from flex_plant_sim.effects.mechanics.bending import BendingTerms, ROUNDING
from flex_plant_sim.effects.mechanics.bending_factors import (
    compiled_field_factors,
    compiled_momentum_factors,
    compiled_remaining,
)
from flex_plant_sim.effects.mechanics.bending_slopes import (
    field_derivatives,
    momentum_derivatives,
    SCALARS,
)
import numpy as np


@compiled
def _spans(rows: Array) -> Any:
    """Return the first column of each row that is not zero, and the one after the last, (m, 2)."""
    found = np.zeros((len(rows), 2), dtype=np.int64)
    for i in range(len(rows)):
        for j in range(rows.shape[1]):
            if rows[i, j] != 0.0:
                found[i, 0] = j if found[i, 1] == 0 else found[i, 0]
                found[i, 1] = j + 1
    return found


@compiled
def _put_products(rows: Array, spans: Any, vector: Array, first: int, found: Array) -> None:
    """Write rows @ vector[first:] into found, by the columns that are not zero."""
    for i in range(len(found)):
        total = 0.0
        for j in range(spans[i, 0], spans[i, 1]):
            total += rows[i, j] * vector[first + j]
        found[i] = total


@compiled
def _reduced(upper: Array, state: Array, over_p: Array, over_v: Array) -> tuple[Any, Any, Any]:
    """Return rate, bent and short of momentum_factors from the products with p and p'."""
    n = len(upper)
    p, beta, dp, dbeta, c_1, c_2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        shorter, spun = over_p[3 + i], over_p[3 + n + i]
        position, velocity = state[i], state[n + i]
        if upper[i] > 0.0:
            p += 0.5 * position * shorter
            dp += velocity * shorter
            c_1 += position * spun
        else:
            beta += 0.5 * position * shorter
            dbeta += velocity * shorter
            c_2 += position * spun
    return ((over_v[0], over_v[1], over_v[2], over_v[3]),
            (over_p[0], over_p[1], np.sin(over_p[2]), np.cos(over_p[2])),
            (p, dp, c_1, beta, dbeta, c_2))


@compiled
def scalars(terms: BendingTerms, state: Array) -> tuple[Any, ...]:
    """Return rate, bent and short of momentum_factors, and the products with p and p'."""
    n = len(terms.upper)
    over_p = np.dot(terms.over_position, state[:n])
    over_v = np.dot(terms.over_velocity, state[n:2 * n])
    rate, bent, short = _reduced(terms.upper, state, over_p, over_v)
    return rate, bent, short, over_p, over_v


@compiled
def _put_momentum(terms: BendingTerms, state: Array, over_p: Array, over_v: Array, found: Array
                  ) -> None:
    rows = terms.over_velocity
    rate, bent, short = _reduced(terms.upper, state, over_p, over_v)
    f = compiled_momentum_factors(rate, bent, short, terms.carried)
    left = compiled_remaining(short, terms.most)
    for i in range(len(found)):
        by = f[4] if terms.upper[i] > 0.0 else f[5]
        found[i] = left * (by * over_p[3 + i] + f[0] * rows[0, i] + f[1] * rows[1, i]
                           + f[2] * rows[2, i] + f[3] * rows[3, i])


@compiled
def _put_slopes(terms: BendingTerms, state: Array, over_p: Array, over_v: Array, found: Array
                ) -> None:
    n, rows, turning = len(terms.upper), terms.over_position, terms.over_velocity
    rate, bent, short = _reduced(terms.upper, state, over_p, over_v)
    f = compiled_field_factors(rate, bent, short, terms.carried)
    left = compiled_remaining(short, terms.most)
    for i in range(n):
        found[i] = (f[0] * rows[0, i] + f[1] * rows[1, i] + f[2] * rows[2, i]
                    + f[5] * turning[2, i] + f[6] * turning[3, i])
        shorter, spun, turned = over_p[3 + i], over_p[3 + n + i], bent[2] * over_v[4 + i]
        if terms.upper[i] > 0.0:
            found[i] += f[3] * shorter + rate[3] * turned + rate[0]**2 * spun
        else:
            found[i] += f[4] * shorter - rate[2] * turned + rate[1]**2 * spun
        found[i] *= left


@compiled
def momentum(terms: BendingTerms, state: Array) -> Array:
    """Return dL/dp' of the energy of second order at a state, (N,)."""
    found = np.empty(len(terms.upper))
    _, _, _, over_p, over_v = scalars(terms, state)
    _put_momentum(terms, state, over_p, over_v, found)
    return found


@compiled
def slopes(terms: BendingTerms, state: Array) -> Array:
    """Return dL/dp, with the forces of M(eta) that CoriolisCentripetal does not have, (N,)."""
    found = np.empty(len(terms.upper))
    _, _, _, over_p, over_v = scalars(terms, state)
    _put_slopes(terms, state, over_p, over_v, found)
    return found


@compiled
def _forces(terms: BendingTerms, states: Array, changes: Array, step: float) -> Array:
    """Return bending_force of arms at states (K, 2 N) that change by (K, 2 N), (K, N)."""
    n = len(terms.upper)
    of_p, of_v = terms.over_position, terms.over_velocity
    span_p, span_v = _spans(of_p), _spans(of_v)
    over_p, over_v = np.empty(3 + 2 * n), np.empty(4 + n)
    found, before, after = np.empty((len(states), n)), np.empty(n), np.empty(n)
    start, state = np.empty(2 * n), np.zeros(2 * n)
    for k in range(len(states)):
        apart = k == 0
        for i in range(2 * n):
            start[i] = states[k, i] - 0.5 * changes[k, i]
            apart |= abs(start[i] - state[i]) > ROUNDING * abs(state[i])
        if apart:
            _put_products(of_p, span_p, start, 0, over_p)
            _put_products(of_v, span_v, start, n, over_v)
            _put_momentum(terms, start, over_p, over_v, before)
        else:
            before[:] = after
        state[:] = states[k]
        _put_products(of_p, span_p, state, 0, over_p)
        _put_products(of_v, span_v, state, n, over_v)
        _put_slopes(terms, state, over_p, over_v, found[k])
        # Where a record's steps follow one another, the next one begins here.
        for i in range(2 * n):
            state[i] += 0.5 * changes[k, i]
        _put_products(of_p, span_p, state, 0, over_p)
        _put_products(of_v, span_v, state, n, over_v)
        _put_momentum(terms, state, over_p, over_v, after)
        for i in range(n):
            found[k, i] -= (after[i] - before[i]) / step
    return found


@compiled
def _masses(terms: BendingTerms, positions: Array) -> Array:
    """
    Return bending_mass of arms at positions (K, N), (K, N, N).

    The momenta are linear in (w_1, w_2, epsilon, sigma, P', beta'), and those in p'.
    """
    n = len(terms.upper)
    found, state, rows = np.empty((len(positions), n, n)), np.zeros(2 * n), np.zeros((6, n))
    rows[:4] = terms.over_velocity[:4]
    by, unit = np.empty((6, n)), np.zeros(6)
    for k in range(len(positions)):
        state[:n] = positions[k]
        _, bent, short, over_p, _ = scalars(terms, state)
        for i in range(n):
            rows[4, i] = terms.upper[i] * over_p[3 + i]
            rows[5, i] = (1.0 - terms.upper[i]) * over_p[3 + i]
        left = compiled_remaining(short, terms.most)
        by[:] = 0.0
        for m in range(6):
            unit[m] = left
            f = compiled_momentum_factors(
                (unit[0], unit[1], unit[2], unit[3]), bent,
                (short[0], unit[4], short[2], short[3], unit[5], short[5]), terms.carried)
            unit[m] = 0.0
            for j in range(n):
                row = rows[m, j]
                by[0, j] += f[0] * row
                by[1, j] += f[1] * row
                by[2, j] += f[2] * row
                by[3, j] += f[3] * row
                by[4, j] += f[4] * row
                by[5, j] += f[5] * row
        for i in range(n):
            for j in range(n):
                total = 0.0
                for m in range(6):
                    total += rows[m, i] * by[m, j]
                found[k, i, j] = total
    return found


def step_force(terms: BendingTerms, position: Array, velocity: Array, change: Array, step: float
               ) -> Array:
    """Return bending_force, (…, N), arm by arm."""
    n = len(terms.upper)
    state = np.concatenate([position, velocity], axis=-1)
    change = np.ascontiguousarray(np.broadcast_to(change, state.shape))
    return _forces(terms, state.reshape(-1, 2 * n), change.reshape(-1, 2 * n), step
                   ).reshape(position.shape)


def step_mass(terms: BendingTerms, position: Array) -> Array:
    """Return bending_mass, (…, N, N), arm by arm."""
    n = len(terms.upper)
    return _masses(terms, np.ascontiguousarray(position).reshape(-1, n)
                   ).reshape(*position.shape, n)


@compiled
def _grouped(z: Array) -> tuple[Any, Any, Any]:
    """Return rate, bent and short of momentum_factors from the scalars of `_over_state`."""
    return ((z[0], z[1], z[2], z[3]), (z[4], z[5], np.sin(z[6]), np.cos(z[6])),
            (z[7], z[8], z[9], z[10], z[11], z[12]))


@compiled
def _over_state(terms: BendingTerms, state: Array) -> tuple[Array, Array, float, Array, Array]:
    """
    Return w_1, w_2, epsilon, sigma, tau, alpha, eta, P, P', C_1, beta, beta', C_2, (13,).

    They are followed by their derivatives over the state, (13, 2 N), the factor by which the
    forces fade, and the products with p and p'.
    """
    n = len(terms.upper)
    rate, _, short, over_p, over_v = scalars(terms, state)
    z, slope = np.empty(SCALARS), np.zeros((SCALARS, 2 * n))
    z[0], z[1], z[2], z[3] = rate
    z[4:7] = over_p[:3]
    z[7], z[8], z[9], z[10], z[11], z[12] = short
    slope[:4, n:], slope[4:7, :n] = terms.over_velocity[:4], terms.over_position[:3]
    for i in range(n):
        k = 7 if terms.upper[i] > 0.0 else 10
        slope[k, i], slope[k + 1, n + i] = over_p[3 + i], over_p[3 + i]
        slope[k + 1, i], slope[k + 2, i] = over_v[4 + i], 2.0 * over_p[3 + n + i]
    return z, slope, compiled_remaining(short, terms.most), over_p, over_v


@compiled
def momentum_slope(terms: BendingTerms, state: Array, first: int) -> Array:
    """
    Return the derivative of `momentum` over the states from `first` on, (N, 2 N - first).

    It includes the factor by which the forces fade, but not the derivative of that factor.
    """
    n, link = len(terms.upper), terms.over_position[3:]
    z, slope, left, over_p, _ = _over_state(terms, state)
    rate, bent, short = _grouped(z)
    f = compiled_momentum_factors(rate, bent, short, terms.carried)
    by = np.dot(momentum_derivatives(z, terms.carried), slope[:, first:].copy())
    found = np.dot(terms.over_velocity[:4].T, by[:4])
    for i in range(n):
        of, own = (by[4], f[4]) if terms.upper[i] > 0.0 else (by[5], f[5])
        found[i] += of * over_p[3 + i]
        found[i, :n - first] += own * link[i, first:]
    return left * found


@compiled
def field_slope(terms: BendingTerms, state: Array) -> Array:
    """Return the derivative of `slopes` over the state, (N, 2 N); see momentum_slope."""
    n, rows = len(terms.upper), terms.over_position
    z, slope, left, over_p, over_v = _over_state(terms, state)
    rate, bent, short = _grouped(z)
    f = compiled_field_factors(rate, bent, short, terms.carried)
    by = np.dot(field_derivatives(z, terms.carried), slope)
    found = np.dot(rows[:3].T, by[:3]) + np.dot(terms.over_velocity[2:4].T, by[5:7])
    for i in range(n):
        # Beside these the upper link has sigma sin(eta) S p' + w_1^2 C p; the lower link likewise.
        upper = terms.upper[i] > 0.0
        of, own = (by[3], f[3]) if upper else (by[4], f[4])
        across, w, sign = (3, 0, 1.0) if upper else (2, 1, -1.0)
        found[i] += of * over_p[3 + i] + 2.0 * z[w] * over_p[3 + n + i] * slope[w]
        found[i] += sign * over_v[4 + i] * (bent[2] * slope[across]
                                            + z[across] * bent[3] * slope[6])
        found[i, :n] += own * rows[3 + i] + z[w]**2 * rows[3 + n + i]
        found[i, n:] += sign * z[across] * bent[2] * rows[3 + i]
    return left * found
