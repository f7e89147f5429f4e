"""How effects read and extend the two kinds of second-order form."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
import math

from flex_plant_sim.arm.assumed_modes import energy_form
from flex_plant_sim.arm.ritz import RitzShapes
from flex_plant_sim.arm.robot import Link, Robot
from flex_plant_sim.arm.second_order import Array, SecondOrderForm, Shapes
import numpy as np
from numpy.typing import NDArray


def is_energy_form(form: SecondOrderForm) -> bool:
    """
    Return whether rows are conjugate to coordinates (a symmetric mass matrix).

    Otherwise the form is the paper's: the rows of theta balance the rotors alone, the rows of
    q_j are link j's equation projected on its shapes, and loads on a link reach a rotor only
    through the link's root moment.
    """
    # One pair tells: only M of an energy couples theta_1 with q_11 as q_11 with theta_1.
    return math.isclose(form.mass[0, 0, 2], form.mass[0, 2, 0], rel_tol=1e-9)


def link_columns(form: SecondOrderForm, index: int) -> NDArray[np.bool_]:
    """Return True where p holds the deflections of a link (index 0 or 1), (N,)."""
    return np.array([name.startswith(f'q_{index + 1}') for name in form.names])


def shapes_of(form: SecondOrderForm, robot: Robot, index: int) -> Shapes:
    """Return the shapes in which the form lets a link bend."""
    modes = int(link_columns(form, index).sum())
    return link_shapes(robot.links[index], modes, is_energy_form(form))


@lru_cache(maxsize=64)
def link_shapes(link: Link, modes: int, energy: bool) -> Shapes:
    """Return the shapes of an energy form or of the paper's."""
    beam = link.beam(modes)
    return RitzShapes.of(beam) if energy else beam


def root_row(form: SecondOrderForm, index: int) -> Array:
    """Return the row of the rotation rate of a link's root, (N,)."""
    base = np.eye(form.order)[0]
    return base if index == 0 else base + form.elbow_angle


def momentum_rows(form: SecondOrderForm, robot: Robot, index: int) -> tuple[Array, Array]:
    """
    Return the angular momentum that a joint's rotor gives its link, over p'.

    Polynomials in cos(theta_2), (3, N) each: without payload, and per kilogram of it. The
    paper's rows of theta hold no momentum but the rotor's, so it is taken from the energy of the
    paper's own shapes.
    """
    if is_energy_form(form):
        mass, payload = form.mass[:, index].copy(), form.payload_mass[:, index]
    else:
        plain = _paper_energy(replace(robot, effects=()), int(link_columns(form, 0).sum()))
        wide = extended(plain, form.names[plain.order:])
        mass, payload = wide.mass[:, index].copy(), wide.payload_mass[:, index]
    mass[0, index] -= robot.drives[index].inertia
    return mass, payload


@lru_cache(maxsize=16)
def _paper_energy(robot: Robot, modes: int) -> SecondOrderForm:
    return energy_form(robot, (robot.links[0].beam(modes), robot.links[1].beam(modes)), modes)


def extended(form: SecondOrderForm, names: tuple[str, ...]) -> SecondOrderForm:
    """Return the form with idle coordinates added at the end, without mass or stiffness."""
    count = len(names)
    square, rows, last = ((0, 0), (0, count), (0, count)), ((0, count), (0, 0)), (0, count)
    return replace(
        form, mass=np.pad(form.mass, square), payload_mass=np.pad(form.payload_mass, square),
        damping=np.pad(form.damping, square[1:]), stiffness=np.pad(form.stiffness, square),
        input_matrix=np.pad(form.input_matrix, rows), force=np.pad(form.force, rows),
        angle=np.pad(form.angle, ((0, 0), last)), strain=np.pad(form.strain, ((0, 0), last)),
        names=form.names + names, elbow_angle=np.pad(form.elbow_angle, (last,)),
        field=np.pad(form.field, ((0, 0), (0, 0), last)))


def decided_by_step(form: SecondOrderForm, name: str) -> SecondOrderForm:
    """Return the form with a coordinate that is stable by itself: nothing to observe there."""
    wide = extended(form, (name,))
    wide.mass[0, -1, -1] = 1.0
    wide.damping[-1, -1], wide.stiffness[0, -1, -1] = 20.0, 100.0
    return wide


def with_root_turn(form: SecondOrderForm, robot: Robot, index: int, turn: Array,
                   carried: float = 0.0) -> SecondOrderForm:
    """
    Return the form of an arm whose link root turns by theta_j + turn p, the rotor by theta_j.

    With E = I + e_j turn', all that the link moves gets E' M E, the rotor stays but for the
    share of its inertia that is carried by the link. The paper's
    rows are balances, not conjugate to coordinates, so there only the columns change: M E.

    Parameters
    ----------
    form : SecondOrderForm
        The arm's equations.
    robot : Robot
        With the parameter effects applied.
    index : int
        Joint and link, 0 or 1.
    turn : Array
        Row over p, (N,).
    carried : float
        Share of the rotor's inertia behind the gear, 0 to 1.

    """
    energy = is_energy_form(form)
    change = np.eye(form.order)
    change[index] += turn
    left = change.T if energy else np.eye(form.order)
    rotor = np.zeros_like(form.mass)
    rotor[0, index, index] = (1.0 - carried) * robot.drives[index].inertia
    changed = replace(form, mass=left @ (form.mass - rotor) @ change + rotor,
                      payload_mass=left @ form.payload_mass @ change)
    if not energy:
        return changed
    return replace(changed, elbow_angle=form.elbow_angle @ change, field=form.field @ change)


def field_load(form: SecondOrderForm, robot: Robot, payload: float, upper: Array, lower: Array,
               cosine: Array) -> Array:
    """
    Return the generalised force of a uniform acceleration field, (…, N).

    The paper's upper link feels the lower one's shear through q_2, and of the field on the lower
    link only what acts along it, (m_l2 + m_p) (a_1 - c a_2).

    Parameters
    ----------
    form : SecondOrderForm
        The arm's equations.
    robot : Robot
        With the parameter effects applied.
    payload : float
        kg.
    upper, lower, cosine : Array
        Field across the upper and across the lower link, m/s^2, and cos(theta_2): (…, 1).

    """
    load_1 = form.field[0, 0] + payload * form.field[0, 1]
    load_2 = form.field[1, 0] + payload * form.field[1, 1]
    if is_energy_form(form):
        return upper * load_1 + lower * load_2
    q_1 = link_columns(form, 0)
    along = (robot.links[1].mass + payload) * form.field[0, 1]
    return (upper * (q_1 * load_1) - cosine * lower * (q_1 * along)
            + lower * (lower_rows(form) * load_2))


def lower_rows(form: SecondOrderForm) -> NDArray[np.bool_]:
    """Return True for the paper's rows that carry loads on the lower link, (N,)."""
    rows = np.logical_not(link_columns(form, 0))
    rows[:2] = False
    return rows


def elbow_state(form: SecondOrderForm, position: Array) -> tuple[Array, Array]:
    """Return cos and sin of the angle between the links, (…, 1)."""
    angle = (position @ form.elbow_angle)[..., None]
    return np.cos(angle), np.sin(angle)
