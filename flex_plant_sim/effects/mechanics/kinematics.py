"""
Helpers with which effects read and extend the two kinds of second-order form.

These are the energy form of assumed_modes and the paper's form.
"""

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
    # One pair decides: only an energy form couples theta_1 to q_11 as q_11 to theta_1.
    return math.isclose(form.mass[0, 0, 2], form.mass[0, 2, 0], rel_tol=1e-9)


def link_columns(form: SecondOrderForm, index: int) -> NDArray[np.bool_]:
    """Return which coordinates are deflections of a link (index 0 or 1), (N,)."""
    return np.array([name.startswith(f'q_{index + 1}') for name in form.names])


def shapes_of(form: SecondOrderForm, robot: Robot, index: int) -> Shapes:
    """Return the shapes in which a link bends in the form."""
    modes = int(link_columns(form, index).sum())
    return link_shapes(robot.links[index], modes, is_energy_form(form))


@lru_cache(maxsize=64)
def link_shapes(link: Link, modes: int, energy: bool) -> Shapes:
    """Return a link's shapes in an energy form, or else in the paper's form."""
    beam = link.beam(modes)
    return RitzShapes.of(beam) if energy else beam


def root_row(form: SecondOrderForm, index: int) -> Array:
    """Return the row of the rotation rate of a link's root, (N,)."""
    base = np.eye(form.order)[0]
    return base if index == 0 else base + form.elbow_angle


def end_rotations(form: SecondOrderForm, robot: Robot) -> Array:
    """Return the rows of the angles by which bending turns the ends of the links, (2, N)."""
    rows = np.zeros((2, form.order))
    for index, link in enumerate(robot.links):
        rows[index, link_columns(form, index)] = shapes_of(form, robot, index).shape(
            link.length, 1)
    return rows


def momentum_rows(form: SecondOrderForm, robot: Robot, index: int) -> tuple[Array, Array]:
    """
    Return the angular momentum that the rotor of a joint transmits to its link, over p'.

    These are polynomials in cos(theta_2), (3, N) each: without payload, and per kilogram of
    payload. The paper's rows of theta hold only the momentum of the rotor, so for that form it is
    taken from the energy of the paper's own shapes.
    """
    if is_energy_form(form):
        mass, payload = form.mass[:, index].copy(), form.payload_mass[:, index]
    else:
        plain = _paper_energy(replace(robot, effects=()), int(link_columns(form, 0).sum()))
        wide = with_coordinates(plain, form.names[plain.order:])
        mass, payload = wide.mass[:, index].copy(), wide.payload_mass[:, index]
    mass[0, index] -= robot.drives[index].inertia
    return mass, payload


@lru_cache(maxsize=16)
def _paper_energy(robot: Robot, modes: int) -> SecondOrderForm:
    return energy_form(robot, (robot.links[0].beam(modes), robot.links[1].beam(modes)), modes)


def with_coordinates(form: SecondOrderForm, names: tuple[str, ...]) -> SecondOrderForm:
    """Return the form with coordinates without mass, stiffness and coupling added at the end."""
    count = len(names)
    square, rows, last = ((0, 0), (0, count), (0, count)), ((0, count), (0, 0)), (0, count)
    return replace(
        form, mass=np.pad(form.mass, square), payload_mass=np.pad(form.payload_mass, square),
        damping=np.pad(form.damping, square[1:]), stiffness=np.pad(form.stiffness, square),
        input_matrix=np.pad(form.input_matrix, rows), force=np.pad(form.force, rows),
        angle=np.pad(form.angle, ((0, 0), last)), strain=np.pad(form.strain, ((0, 0), last)),
        names=form.names + names, elbow_angle=np.pad(form.elbow_angle, (last,)),
        field=np.pad(form.field, ((0, 0), (0, 0), last)))


def with_step_coordinate(form: SecondOrderForm, name: str) -> SecondOrderForm:
    """
    Return the form with an uncoupled coordinate, which an effect sets within the step.

    It has stable dynamics of its own, so that a filter does not have to observe it.
    """
    wide = with_coordinates(form, (name,))
    wide.mass[0, -1, -1] = 1.0
    wide.damping[-1, -1], wide.stiffness[0, -1, -1] = 20.0, 100.0
    return wide


def with_root_turn(form: SecondOrderForm, robot: Robot, index: int, turn: Array,
                   carried: float = 0.0) -> SecondOrderForm:
    """
    Return the form of an arm whose link root turns by theta_j + turn p, the rotor by theta_j.

    With E = I + e_j turn', the mass matrix of all that the link moves becomes E' M E; of the
    rotor only the share of its inertia that the link carries takes part. The paper's rows are
    balances and not conjugate to coordinates, so in its form only the columns change: M E.

    Parameters
    ----------
    form : SecondOrderForm
        The arm's equations.
    robot : Robot
        Robot with the parameter effects applied.
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

    In the paper's form the shear of the lower link acts on the upper link through q_2. Of the
    field on the lower link, only the part along the link acts on the upper one:
    (m_l2 + m_p) (a_1 - c a_2).

    Parameters
    ----------
    form : SecondOrderForm
        The arm's equations.
    robot : Robot
        Robot with the parameter effects applied.
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
    """Return which rows of the paper's form carry loads on the lower link, (N,)."""
    rows = np.logical_not(link_columns(form, 0))
    rows[:2] = False
    return rows


def elbow_state(form: SecondOrderForm, position: Array) -> tuple[Array, Array]:
    """Return cos and sin of the angle between the links, (…, 1)."""
    angle = (position @ form.elbow_angle)[..., None]
    return np.cos(angle), np.sin(angle)
