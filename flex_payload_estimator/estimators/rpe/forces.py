"""
The forces of motion: Coriolis and centripetal ones, and what bent links add to first order.

They are those of the effects CoriolisCentripetal and Foreshortening, which follow from one energy;
here for one step of a filter, at the payload that it estimates.
"""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.small_matrices import applied, inner, inverse, product
from flex_payload_estimator.kalman.in_place import add, add_column, add_outer, put
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
from flex_plant_sim.effects.mechanics.bending import bending_terms, BendingTerms
from flex_plant_sim.effects.mechanics.bending_step import (
    field_slope,
    momentum,
    momentum_slope,
    slopes,
)
from flex_plant_sim.effects.mechanics.kinematics import is_energy_form, root_row
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

# Rows of `motion_rows`, over the coordinates: the elbow's velocity e; the static moments s_0 of
# the lower link and s_1 per kg of payload; the angular rates w_1 and w_2 of the links' roots; the
# angle between the links. With bending also: which coordinates are deflections of the upper link;
# BendingTerms' numbers and the sampling time, without payload, and per kg of it; and from FIRST on
# BendingTerms' over_position, likewise.
ELBOW, ACROSS, PER_KG, ROOT_1, ROOT_2, ANGLE, UPPER, NUMBERS, FIRST = *range(8), 9
# Step of the finite difference over the payload, kg.
PAYLOAD_STEP = 1e-6


def moves(arm: ExtendedArm) -> bool:
    """Tell whether an arm has forces of motion; the paper's equations, of no energy, do not."""
    return arm.compact is None and is_energy_form(arm.form)


def motion_rows(arm: ExtendedArm, bent: bool = True) -> Array:
    """
    Return the rows over the coordinates from which the forces of motion are computed.

    Parameters
    ----------
    arm : ExtendedArm
        The model.
    bent : bool
        Whether with the terms of bending links.

    Returns
    -------
    Array
        (15 + 4 N, N), or (6, N) for rigid links; (0, N) for an arm without forces of motion.

    """
    form = arm.form
    if not moves(arm):
        return np.zeros((0, form.order))
    rigid = np.vstack([form.field[0, 1], form.field[1], root_row(form, 0), root_row(form, 1),
                       form.elbow_angle])
    if not bent:
        return rigid
    empty, loaded = (bending_terms(form, arm.robot, payload) for payload in (0.0, 1.0))
    numbers = np.zeros((2, form.order))
    for row, terms in zip(numbers, (empty, loaded)):
        row[:4] = terms.carried, *terms.most, arm.step_time
    numbers[1] -= numbers[0]
    return np.vstack([rigid, empty.upper, numbers, empty.over_position,
                      loaded.over_position - empty.over_position])


@compiled
def terms_at(rows: Array, mass: float) -> BendingTerms:
    """Return the terms of an arm with a payload, kg; see bending.bending_terms."""
    size = (len(rows) - FIRST) // 2
    over_position = rows[FIRST:FIRST + size] + mass * rows[FIRST + size:]
    n = rows.shape[1]
    over_velocity = np.empty((4 + n, n))
    over_velocity[0], over_velocity[1] = rows[ROOT_1], rows[ROOT_2]
    over_velocity[2] = rows[ELBOW]
    over_velocity[3] = rows[ACROSS] + mass * rows[PER_KG]
    over_velocity[4:] = over_position[3:3 + n]
    numbers = rows[NUMBERS] + mass * rows[NUMBERS + 1]
    return BendingTerms(over_position, over_velocity, rows[UPPER], numbers[0],
                        (numbers[1], numbers[2]))


@compiled
def rigid_force(rows: Array, mass: float, middle: Array) -> tuple[Array, Array, Array]:
    """
    Return sin(eta) (sigma w_2 e - epsilon w_1 s), (N,), at the middle of a step.

    Then its derivatives over the state, (N, n), and over the payload, (N,).
    """
    n, per_kg, elbow = rows.shape[1], rows[PER_KG], rows[ELBOW]
    rate, across = middle[n:2 * n], rows[ACROSS].copy()
    add(across, mass, per_kg)
    epsilon, sigma = inner(elbow, rate), inner(across, rate)
    w_1, w_2 = inner(rows[ROOT_1], rate), inner(rows[ROOT_2], rate)
    angle = inner(rows[ANGLE], middle[:n])
    sine, cosine = np.sin(angle), np.cos(angle)
    along, beside = sigma * w_2, -epsilon * w_1
    # Of what acts along the elbow's row, and of what does across.
    by_elbow, by_across = np.zeros(middle.size), np.zeros(middle.size)
    add(by_elbow[:n], cosine * along, rows[ANGLE])
    add(by_across[:n], cosine * beside, rows[ANGLE])
    add(by_elbow[n:2 * n], sine * sigma, rows[ROOT_2])
    add(by_elbow[n:2 * n], sine * w_2, across)
    add(by_across[n:2 * n], -sine * epsilon, rows[ROOT_1])
    add(by_across[n:2 * n], -sine * w_1, elbow)
    over_state, over_mass, force = np.zeros((n, middle.size)), np.zeros(n), np.zeros(n)
    add_outer(over_state, elbow, by_elbow)
    add_outer(over_state, across, by_across)
    add(over_mass, sine * inner(per_kg, rate) * w_2, elbow)
    add(over_mass, sine * beside, per_kg)
    add(force, sine * along, elbow)
    add(force, sine * beside, across)
    return force, over_state, over_mass


@compiled
def bent_force(terms: BendingTerms, before: Array, x: Array, after: Array, step: float) -> Array:
    """Return the mean force of bent links over a step, s, from x with momentum `before`, (N,)."""
    return slopes(terms, 0.5 * (x + after)) - (momentum(terms, after) - before) / step


@compiled
def newton_matrix(mass: Array, push: Array, step: float) -> Array:
    """
    Return Newton's matrix, (N, N), by which the forces' residual corrects them.

    That is (1 + M_b E_v / T)^-1.

    Parameters
    ----------
    mass : Array
        M_b, the derivative of bent links' momentum over the velocity, (N, N).
    push : Array
        Change of the state over a step by a unit of each force, (n, N); E_v is that of the
        velocities.
    step : float
        T, s.

    """
    n = push.shape[1]
    return inverse(np.eye(n) + product(mass, push[n:2 * n]) / step)


@compiled
def _bent(rows: Array, mass: float, x: Array, after: Array, push: Array
          ) -> tuple[Array, Array, Array, Array]:
    """
    Return the forces of motion and their partial derivatives, see `forces_of_motion`.

    The forces of bent links depend on the acceleration, and so on themselves. They are solved by
    two steps of Newton's method, as in the simulator (stepping.py), so that the model is its arm
    to rounding. At 0.3 kg in fast motion two fixed-point (Picard) evaluations are off by 6 % of
    the largest force at 100 Hz, by 25 % at 1 kHz.
    """
    terms, step, n = terms_at(rows, mass), rows[NUMBERS, 3], rows.shape[1]
    before = momentum(terms, x)
    force = rigid_force(rows, mass, 0.5 * (x + after))[0] \
        + bent_force(terms, before, x, after, step)
    force = applied(newton_matrix(momentum_slope(terms, after, n), push, step), force)
    guess = after + applied(push, force)
    middle = 0.5 * (x + guess)
    rigid, over_x, over_mass = rigid_force(rows, mass, middle)
    bent, slope_after = bent_force(terms, before, x, guess, step), momentum_slope(terms, guess, 0)
    residual = rigid + bent - force
    force = force + applied(newton_matrix(slope_after[:, n:].copy(), push, step), residual)
    over_x *= 0.5
    over_x[:, :2 * n] += 0.5 * field_slope(terms, middle)
    over_after = over_x.copy()
    over_x[:, :2 * n] += momentum_slope(terms, x, 0) / step
    over_after[:, :2 * n] -= slope_after / step
    heavier = terms_at(rows, mass + PAYLOAD_STEP)
    more = bent_force(heavier, momentum(heavier, x), x, guess, step)
    return force, over_x, over_after, over_mass + (more - bent) / PAYLOAD_STEP


@compiled
def forces_of_motion(rows: Array, mass: float, x: Array, after: Array, push: Array
                     ) -> tuple[Array, Array, Array, Array]:
    """
    Return the forces of motion over a step, (N,), and their derivatives.

    Over the state before the step, and over the one after it without these forces, (N, n) each;
    over the payload, (N,). They are total derivatives: bent links' forces act on themselves.

    Parameters
    ----------
    rows : Array
        See motion_rows.
    mass : float
        Payload, kg.
    x, after : Array
        State before the step and, without these forces, after it, (n,).
    push : Array
        Change of the state by a unit of each force, times the share of the forces, (n, N).

    """
    if len(rows) > NUMBERS:
        force, over_x, over_after, over_mass = _bent(rows, mass, x, after, push)
        through = inverse(np.eye(len(force)) - product(over_after, push))
        return (force, product(through, over_x), product(through, over_after),
                applied(through, over_mass))
    # From the middle of the step, so that the scheme is of second order.
    force, over_x, over_mass = rigid_force(rows, mass, 0.5 * (x + after))
    over_x *= 0.5
    return force, over_x, over_x, over_mass


@compiled
def tip_force(rows: Array, x: Array, force: Array, push: Array) -> tuple[Array, Array, Array]:
    """
    Return the change of the state by a constant force at the tip over a step, (n,).

    To first order in the deflections; then its derivatives over the state, (n, n), and over the
    force, (n, 2). The tip moves with the elbow across the upper link, and relative to it across
    the lower one.

    Parameters
    ----------
    rows : Array
        See motion_rows.
    x, force : Array
        State, (n,), and force along the world's axes, N, (2,).
    push : Array
        Change of the state by a unit of each generalised force, (n, N).

    """
    n = rows.shape[1]
    elbow, tip = applied(push, rows[ELBOW]), applied(push, rows[PER_KG])
    first = x[0]
    second = first + inner(rows[ANGLE], x[:n])
    over_force, over_x = np.zeros((x.size, 2)), np.zeros((x.size, x.size))
    add_column(over_force, 0, -np.sin(first), elbow)
    add_column(over_force, 0, -np.sin(second), tip)
    add_column(over_force, 1, np.cos(first), elbow)
    add_column(over_force, 1, np.cos(second), tip)
    # The derivative over a link's angle of the force across it is minus that along it.
    over_first = -(np.cos(first) * force[0] + np.sin(first) * force[1])
    over_second, angle_row = np.zeros(x.size), np.zeros(x.size)
    add(over_second, -(np.cos(second) * force[0] + np.sin(second) * force[1]), tip)
    put(angle_row[:n], rows[ANGLE])
    angle_row[0] += 1.0
    add_outer(over_x, over_second, angle_row)
    add_column(over_x, 0, over_first, elbow)
    return applied(over_force, force), over_x, over_force


@compiled
def scheduling_row(rows: Array, states: int) -> Array:
    """
    Return the row over the state, (n,), that adds to theta_2 for the schedule's angle at share 1.

    See stepping.schedule_row: the schedule's angle is that between the links; with forces of bent
    links, in the middle of the step.
    """
    row, order = np.zeros(states), rows.shape[1]
    put(row[:order], rows[ANGLE])
    row[1] -= 1.0
    if len(rows) > NUMBERS:
        add(row[order:2 * order], 0.5 * rows[NUMBERS, 3], rows[ANGLE])
    return row
