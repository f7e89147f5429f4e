"""
The time update of the augmented Kalman filter in Friedland's form, on plain arrays.

Friedland (IEEE Trans. Autom. Control 14, 1969) factors the joint posterior of the state x, (n,),
and the constant parameters beta, (B,):

* P, (n, n): covariance of the state for known parameters;
* s = dx/dbeta, (n, B): sensitivity of the state;
* V, (B, B): covariance of beta.

The joint covariance is [P + s V s', s V; V s', V]. The columns of s are the payload, the share of
the forces of motion, each gauge's bias and the zero of joint 2's angle; with free parts also the
constant disturbances, each part and each gauge's gain. The same code runs with and without Numba.
"""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.cosine_series import series_at
from flex_payload_estimator.estimators.rpe.forces import (
    forces_of_motion,
    scheduling_row,
    tip_force,
)
from flex_payload_estimator.estimators.rpe.small_matrices import (
    applied,
    combined,
    inner,
    inverse_column,
    product,
    squared,
)
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

# Columns of s: payload, share of the forces of motion (Coriolis and centripetal, and those of bent
# links), and the first gauge's bias.
MASS, CORIOLIS, FIRST_BIAS = 0, 1, 2
# Number of constant disturbances, whose columns are between the zero and the parts: a force at
# the tip along the world's axes, N, and a bias of each drive, in the command's unit.
DISTURBANCES = 4


@compiled
def _first_part(size: int, count: int) -> int:
    """Return the first column of `count` parts, of `size` columns in all."""
    # Before them are as many biases as gains are behind them, and the zero besides.
    return FIRST_BIAS + DISTURBANCES + (size - FIRST_BIAS - count - DISTURBANCES + 1) // 2


@compiled
def _part_deviations(parts: Array, beta: Array, inputs: Array, over_beta: Array, jacobian: Array
                     ) -> Array:
    """
    Return what the parts' deviations add to M d, (n,).

    Writes the columns d(M d)/d(part), and adds d(M d)/dx of the deviations to the Jacobian.
    """
    n, width, count = len(over_beta), len(over_beta) + 2, len(parts)
    first = _first_part(beta.size, count)
    over_parts = applied(parts.reshape(-1, width), inputs[:width]).reshape(-1, n).T
    over_beta[:, first:first + count] = over_parts
    deviations = beta[first:first + count].copy()
    if not deviations.any():
        return np.zeros(n)
    matrix = combined(deviations, parts).reshape(n, width)
    jacobian += matrix[:, :n]
    return applied(matrix, inputs[:width])


@compiled
def _add_parts(increment: Array, jacobian: Array, over_beta: Array, parts: Array, x: Array,
               beta: Array, inputs: Array, motion: Array, force_matrix: Array,
               command_matrix: Array) -> None:
    """Add what parts and constant disturbances do to M d and to its derivatives."""
    add(increment, 1.0, _part_deviations(parts, beta, inputs, over_beta, jacobian))
    first = _first_part(beta.size, len(parts))
    over_beta[:, first - 2:first] = command_matrix
    if len(motion) > 0:
        by_force, over_x, over_beta[:, first - 4:first - 2] = tip_force(
            motion, x, beta[first - 4:first - 2], force_matrix)
        add(increment, 1.0, by_force)
        add_matrix(jacobian, 1.0, over_x)


@compiled
def _inputs(x: Array, command: Array, beta: Array, parts: int, width: int) -> Array:
    """Return d = (x, u, f), (width,), with the drives' biases, and no forces of motion yet."""
    n, inputs = x.size, np.zeros(width)
    put(inputs[:n], x)
    put(inputs[n:n + 2], command)
    if parts > 0:
        first = _first_part(beta.size, parts)
        add(inputs[n:n + 2], 1.0, beta[first - 2:first])
    return inputs


@compiled
def _add_reaction(jacobian: Array, over_beta: Array, push: Array, over_before: Array,
                  over_after: Array, over_mass: Array) -> None:
    """Add to both derivatives how the state before and after the step changes the forces."""
    force_slope = product(over_after, jacobian)
    add_matrix(force_slope, 1.0, over_before)
    add_matrix(force_slope, 1.0, over_after)
    add_matrix(over_beta, 1.0, product(push, product(over_after, over_beta)))
    add_column(over_beta, MASS, 1.0, applied(push, over_mass))
    add_matrix(jacobian, 1.0, product(push, force_slope))


@compiled
def _increment(x: Array, beta: Array, series: Array, parts: Array, mass_offset: float,
               command: Array, motion: Array) -> tuple[Array, Array, Array, Array]:
    """
    Return the increment of one step and its derivatives; see `predict` for the parameters.

    M d, (n,); J = d(M d)/dx, (n, n); d(M d)/dbeta, (n, B); the columns of M for commands, (n, 2).
    """
    n, moves, share = x.size, len(motion) > 0, beta[CORIOLIS]
    # The angle at which M is taken: theta_2, and with forces of motion that between the links.
    over_state = scheduling_row(motion, n) if moves else np.zeros(n)
    angle_offset = inner(over_state, x)
    flat, over_angle, over_mass = series_at(x[1] + share * angle_offset, series, mass_offset)
    matrix = flat.reshape(n, -1)
    inputs = _inputs(x, command, beta, len(parts), matrix.shape[1])
    over_beta, jacobian = np.zeros((n, beta.size)), matrix[:, :n].copy()
    force_matrix, command_matrix = matrix[:, n + 2:].copy(), matrix[:, n:n + 2].copy()
    increment = applied(matrix, inputs)
    if len(parts) > 0:
        _add_parts(increment, jacobian, over_beta, parts, x, beta, inputs, motion, force_matrix,
                   command_matrix)
    if moves:
        push = share * force_matrix
        force, over_before, over_after, force_over_mass = forces_of_motion(
            motion, beta[MASS], x, x + increment, push)
        by_force = applied(force_matrix, force)
        add(increment, share, by_force)
        add(inputs[n + 2:], share, force)
        add_column(over_beta, CORIOLIS, 1.0, by_force)
    turned = applied(over_angle.reshape(matrix.shape), inputs)
    add_column(over_beta, MASS, 1.0, applied(over_mass.reshape(matrix.shape), inputs))
    add_column(over_beta, CORIOLIS, angle_offset, turned)
    over_state *= share
    over_state[1] += 1.0
    add_outer(jacobian, turned, over_state)
    if moves:
        _add_reaction(jacobian, over_beta, push, over_before, over_after, force_over_mass)
    return increment, jacobian, over_beta, command_matrix


@compiled
def _propagate(jacobian: Array, cov: Array, noise: Array) -> None:
    """Make P (I + J) P (I + J)' + Q, in place."""
    half = product(jacobian, cov)
    add_both(cov, 1.0, half)
    add_matrix(cov, 1.0, squared(half, jacobian))
    add_matrix(cov, 1.0, noise)


@compiled
def _compose(jacobian: Array, columns: Array, noise: Array, steps: int
             ) -> tuple[Array, Array, Array]:
    """
    Return J, the columns and Q of several equal steps in a row.

    A step takes a column c to (I + J) c + column, and P to (I + J) P (I + J)' + Q. By doubling:
    two steps have J_1 + J_2 + J_2 J_1, in which a small J keeps its digits.
    """
    all_jacobian, all_columns = np.zeros_like(jacobian), np.zeros_like(columns)
    all_noise = np.zeros_like(noise)
    while True:
        if steps % 2 == 1:
            all_columns = all_columns + columns + product(jacobian, all_columns)
            _propagate(jacobian, all_noise, noise)
            all_jacobian = all_jacobian + jacobian + product(jacobian, all_jacobian)
        steps //= 2
        if steps == 0:
            return all_jacobian, all_columns, all_noise
        columns = 2.0 * columns + product(jacobian, columns)
        noise, once = noise.copy(), noise
        _propagate(jacobian, noise, once)
        jacobian = 2.0 * jacobian + product(jacobian, jacobian)


@compiled
def predict(x: Array, cov: Array, sensitivity: Array, beta: Array, series: Array, parts: Array,
            mass_offset: float, command: Array, motion: Array, torque: Array, steps: int) -> None:
    """
    Predict x, P and s over sampling times of one command, in delta form, in place.

    With the increments M d, d = (x, u, f) and f the forces of motion,

        x <- x + M d,   M = sum_k cos(k angle) M_k(m) + sum_p delta_p dM/dp,
        J = d(M d)/dx,   P <- (I + J) P (I + J)' + Q,   s <- (I + J) s + d(M d)/dbeta.

    Several sampling times have the J, command and derivatives of the first.

    Parameters
    ----------
    x, cov, sensitivity, beta : Array
        (n,), (n, n) and (n, B), changed; parameters at which the model is evaluated, (B,).
    series : Array
        M_k with derivatives over the payload, see schedule.PayloadSlice.
    parts : Array
        dM/dp of states and commands at this angle, (p, n (n + 2)); p = 0 for exact parts.
    mass_offset : float
        Payload less that of the slice, kg.
    command : Array
        u, held over each sampling time, (2,).
    motion : Array
        See forces.motion_rows; (0, N) without forces of motion.
    torque : Array
        Standard deviation of the command's disturbance, in its unit, (2,).
    steps : int
        Number of sampling times.

    """
    increment, jacobian, over_beta, command_matrix = _increment(x, beta, series, parts,
                                                                mass_offset, command, motion)
    command_matrix = scaled(command_matrix, torque)
    noise = squared(command_matrix, command_matrix)
    if steps > 1:
        columns = np.column_stack((increment, over_beta))
        jacobian, columns, noise = _compose(jacobian, columns, noise, steps)
        increment, over_beta = columns[:, 0].copy(), columns[:, 1:].copy()
    add(x, 1.0, increment)
    _propagate(jacobian, cov, noise)
    add_matrix(over_beta, 1.0, product(jacobian, sensitivity))
    add_matrix(sensitivity, 1.0, over_beta)


@compiled
def walk(cov: Array, sensitivity: Array, beta_cov: Array, variance: float) -> None:
    """
    Let the payload walk at random by a variance q, kg^2: P, s and V change in place.

    The state does not change with the walk, so s shrinks and P takes what s no longer explains.
    Exact for the joint covariance: with r the payload's row of V^-1, a = q / (1 + q r_m) and s_m
    the payload's column of s, P <- P + a s_m s_m', s <- s - a s_m r, V_mm <- V_mm + q.
    """
    row = inverse_column(beta_cov)
    share = variance / (1.0 + variance * row[MASS])
    column = sensitivity[:, MASS].copy()
    moved = share * column
    add_outer(cov, moved, column)
    add_outer(sensitivity, -moved, row)
    beta_cov[MASS, MASS] += variance
