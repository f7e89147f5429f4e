"""
The joint posterior of state, payload and parts, a sample on, on plain arrays.

Friedland's factored form of the augmented Kalman filter (IEEE Trans. Autom. Control 14, 1969):
P is the state's covariance for known parameters beta, s = dx/dbeta, V the covariance of beta; the
joint covariance is [P + s V s', s V; V s', V]. Columns of s: payload, share of the forces of
motion, bias of each gauge; then, where parts count, what forces last, each part and the gain of
each gauge.
The same code runs with and without Numba.
"""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.forces import (
    forces_of_motion,
    scheduling_row,
    tip_force,
)
from flex_payload_estimator.estimators.rpe.products import (
    applied,
    combined,
    inner,
    inverse_column,
    product,
    squared,
)
from flex_payload_estimator.estimators.rpe.series import series_at
from flex_payload_estimator.kalman.in_place import (
    add,
    add_both,
    add_column,
    add_matrix,
    add_outer,
    put,
    scaled,
)
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
import numpy as np

# Columns of s before the gauges' biases.
MASS, CORIOLIS, FIRST_BIAS = 0, 1, 2
# Columns of what lasts, between biases and parts: a force at the tip along the world's axes, N,
# and a bias of each drive, in the command's unit.
FORCES = 4


@compiled
def _first_part(size: int, count: int) -> int:
    """Return the first column of so many parts, of so many columns in all."""
    return FIRST_BIAS + FORCES + (size - FIRST_BIAS - count - FORCES) // 2


@compiled
def _off_nominal(parts: Array, anchor: Array, drive: Array, moved: Array, jacobian: Array
                 ) -> Array:
    """Write d(M d)/d(part); add what the parts' deviations add to M, and return that to M d."""
    n, held, count = len(moved), len(moved) + 2, len(parts)
    first = _first_part(anchor.size, count)
    over = applied(parts.reshape(-1, held), drive[:held]).reshape(-1, n).T
    moved[:, first:first + count] = over
    deviations = anchor[first:first + count].copy()
    if not deviations.any():
        return np.zeros(n)
    off = combined(deviations, parts).reshape(n, held)
    jacobian += off[:, :n]
    return applied(off, drive[:held])


@compiled
def _stepped(x: Array, anchor: Array, series: Array, parts: Array, away: float,
             command: Array, motion: Array) -> tuple[Array, Array, Array, Array]:
    """Return M d, its derivatives over state and parameters, and what of M commands meet."""
    n, moves, share = x.size, len(motion) > 0, anchor[CORIOLIS]
    lean = scheduling_row(motion, n) if moves else np.zeros(n)
    beyond = inner(lean, x)
    flat, over_angle, over_m = series_at(x[1] + share * beyond, series, away)
    held = flat.size // n
    matrix, drive = flat.reshape(n, held), np.zeros(held)
    put(drive[:n], x)
    put(drive[n:n + 2], command)
    moved, jacobian = np.zeros((n, anchor.size)), matrix[:, :n].copy()
    entry, given = matrix[:, n + 2:].copy(), matrix[:, n:n + 2].copy()
    if len(parts) > 0:
        last = _first_part(anchor.size, len(parts))
        add(drive[n:n + 2], 1.0, anchor[last - 2:last])
    increment = applied(matrix, drive)
    if len(parts) > 0:
        _add_parts(increment, jacobian, moved, parts, x, anchor, drive, motion, entry, given)
    if moves:
        push = share * entry
        after = x + increment
        force, over_x, over_after, over_mass = forces_of_motion(motion, anchor[MASS], x, after,
                                                                push)
        driven = applied(entry, force)
        add(increment, share, driven)
        add(drive[n + 2:], share, force)
        add_column(moved, CORIOLIS, 1.0, driven)
    turned = applied(over_angle.reshape(n, held), drive)
    add_column(moved, MASS, 1.0, applied(over_m.reshape(n, held), drive))
    add_column(moved, CORIOLIS, beyond, turned)
    lean *= share
    lean[1] += 1.0
    add_outer(jacobian, turned, lean)
    if moves:
        # What changes the step changes the forces over it.
        over_state = product(over_after, jacobian)
        add_matrix(over_state, 1.0, over_x)
        add_matrix(over_state, 1.0, over_after)
        add_matrix(moved, 1.0, product(push, product(over_after, moved)))
        add_column(moved, MASS, 1.0, applied(push, over_mass))
        add_matrix(jacobian, 1.0, product(push, over_state))
    return increment, jacobian, moved, given


@compiled
def _add_parts(increment: Array, jacobian: Array, moved: Array, parts: Array, x: Array,
               anchor: Array, drive: Array, motion: Array, entry: Array, given: Array) -> None:
    """Add what parts and forces that last do to M d and to its derivatives."""
    add(increment, 1.0, _off_nominal(parts, anchor, drive, moved, jacobian))
    last = _first_part(anchor.size, len(parts))
    moved[:, last - 2:last] = given
    if len(motion) > 0:
        blown, turned, moved[:, last - 4:last - 2] = tip_force(
            motion, x, anchor[last - 4:last - 2], entry)
        add(increment, 1.0, blown)
        add_matrix(jacobian, 1.0, turned)


@compiled
def _carry(jacobian: Array, cov: Array, noise: Array) -> None:
    """Make P (I + J) P (I + J)' + Q."""
    half = product(jacobian, cov)
    add_both(cov, 1.0, half)
    add_matrix(cov, 1.0, squared(half, jacobian))
    add_matrix(cov, 1.0, noise)


@compiled
def _composed(jacobian: Array, given: Array, noise: Array, steps: int
              ) -> tuple[Array, Array, Array]:
    """
    Return J, the columns added and Q of many equal steps that follow each other.

    A step takes x to (1 + J) x + given, and P to (1 + J) P (1 + J)' + Q. By doubling: two steps
    have J1 + J2 + J2 J1, in which a small J keeps its digits.
    """
    far, added, spread = np.zeros_like(jacobian), np.zeros_like(given), np.zeros_like(noise)
    while True:
        if steps % 2 == 1:
            added = added + given + product(jacobian, added)
            _carry(jacobian, spread, noise)
            far = far + jacobian + product(jacobian, far)
        steps //= 2
        if steps == 0:
            return far, added, spread
        given = 2.0 * given + product(jacobian, given)
        noise, once = noise.copy(), noise
        _carry(jacobian, noise, once)
        jacobian = 2.0 * jacobian + product(jacobian, jacobian)


@compiled
def predict(x: Array, cov: Array, sens: Array, anchor: Array, series: Array, parts: Array,
            away: float, command: Array, motion: Array, torque: Array, steps: int
            ) -> None:
    """
    Bring state, covariance and sensitivity so many samples on, in delta form.

    x+ = x + M d with d = (x, u, forces of motion) and M = sum_k cos(k angle) M_k(m) + parts' dM,
    s+ = s + J s + dM/dbeta d, P+ = (I + J) P (I + J)' + Q, J = d(M d)/dx. Several samples go by
    with the same J, command and derivatives.

    Parameters
    ----------
    x, cov, sens, anchor : Array
        (n,), (n, n), (n, B) and the parameters that the model is evaluated at, (B,).
    series : Array
        See PayloadSlice.
    parts : Array
        dM/d(part) of states and commands at this angle, (p, n (n + 2)), p = 0 for exact parts.
    away : float
        m - slice payload, kg.
    command : Array
        u held over the sample, (2,).
    motion : Array
        See forces.motion_rows; (0, N) without forces of motion.
    torque : Array
        Standard deviation of the command's disturbance, in its unit, (2,).
    steps : int
        How many samples.

    """
    increment, jacobian, moved, given = _stepped(x, anchor, series, parts, away, command,
                                                 motion)
    given = scaled(given, torque)
    noise = squared(given, given)
    if steps > 1:
        columns = np.column_stack((increment, moved))
        jacobian, columns, noise = _composed(jacobian, columns, noise, steps)
        increment, moved = columns[:, 0].copy(), columns[:, 1:].copy()
    add(x, 1.0, increment)
    _carry(jacobian, cov, noise)
    add_matrix(moved, 1.0, product(jacobian, sens))
    add_matrix(sens, 1.0, moved)


@compiled
def walk(cov: Array, sens: Array, spread: Array, variance: float) -> None:
    """
    Let the payload walk at random by `variance`, kg^2, since the sample: changes P, s and V.

    Exact for the joint covariance: of what x was thought to owe to the payload, the part that
    the walk makes doubtful goes to P.
    """
    row = inverse_column(spread)
    share = variance / (1.0 + variance * row[MASS])
    column = sens[:, MASS].copy()
    much = share * column
    add_outer(cov, much, column)
    add_outer(sens, -much, row)
    spread[MASS, MASS] += variance
