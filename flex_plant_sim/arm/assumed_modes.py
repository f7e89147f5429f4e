"""
Assumed-modes arm model, derived from the kinetic and elastic energy of the whole arm.

It turns a robot and its Ritz shapes into the second-order form that the plant is built from.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

from flex_plant_sim.arm.ritz import RitzShapes
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import (
    angle_rows,
    Array,
    coordinate_names,
    link_slice,
    modal_damping,
    SecondOrderForm,
    Shapes,
    strain_rows,
)
import numpy as np


def assumed_modes(robot: Robot, modes: int) -> SecondOrderForm:
    """
    Return the arm model whose links bend in Ritz shapes; its arrays are read-only.

    Models of equal robots are shared, since the effects of a robot do not enter them.
    """
    return _cached_form(replace(robot, effects=()), modes)


@lru_cache(maxsize=8)
def _cached_form(robot: Robot, modes: int) -> SecondOrderForm:
    shapes = (RitzShapes.of(robot.links[0].beam(modes)), RitzShapes.of(robot.links[1].beam(modes)))
    form = energy_form(robot, shapes, modes)
    for part in vars(form).values():
        if isinstance(part, np.ndarray):
            part.setflags(write=False)
    return form


def energy_form(robot: Robot, shapes: tuple[Shapes, Shapes], modes: int) -> SecondOrderForm:
    """
    Return the form with the mass matrix of the kinetic energy (symmetric, positive definite).

    With the rows e of the elbow's velocity across the upper link, s of the lower link's static
    moment and t of the velocity of the payload's centre across the lower link,

        T = T_1 + (m_h + m_l2) (e p')^2 / 2 + c (e p') (s p') + T_2
            + m_p ((e p')^2 + 2 c (e p') (t p') + (t p')^2) / 2 + rotors,

    which, like the paper's equations, is linear in the deflections.
    """
    order, rows = 2 + 2 * modes, KinematicRows.of(robot, shapes, modes)
    mass, payload = np.zeros((3, order, order)), np.zeros((3, order, order))
    mass[0] = (_link_mass(robot, 0, shapes, rows.base_1)
               + _link_mass(robot, 1, shapes, rows.root_2)
               + (robot.elbow_mass + robot.links[1].mass) * _square(rows.elbow)
               + robot.elbow_inertia * _square(rows.elbow_slope)
               + robot.payload_inertia * _square(rows.tip_slope))
    mass[0, [0, 1], [0, 1]] += [drive.inertia for drive in robot.drives]
    mass[1] = _symmetric(rows.elbow, rows.static_moment_2)
    payload[0] = _square(rows.elbow) + _square(rows.payload)
    payload[1] = _symmetric(rows.elbow, rows.payload)
    damping, stiffness = elastic_and_drive_terms(robot, shapes, modes)
    inputs = np.zeros((order, 2))
    inputs[[0, 1], [0, 1]] = [drive.torque_gain for drive in robot.drives]
    return SecondOrderForm(
        mass, payload, damping, stiffness, inputs, np.eye(order, 2), angle_rows(modes),
        strain_rows(robot, shapes, modes), coordinate_names(modes),
        elbow_angle=rows.root_2 - rows.base_1,
        field=np.array([[rows.static_moment_1, rows.elbow],
                        [rows.static_moment_2, rows.payload]]))


def elastic_and_drive_terms(robot: Robot, shapes: tuple[Shapes, Shapes],
                            modes: int) -> tuple[Array, Array]:
    """Return D (N, N) and K (3, N, N) of the links' bending and of the drives' damping."""
    order = 2 + 2 * modes
    damping, stiffness = np.zeros((order, order)), np.zeros((3, order, order))
    for j, link in enumerate(robot.links):
        diagonal = np.arange(order)[link_slice(j, modes)]
        stiffness[0, diagonal, diagonal] = shapes[j].modal_mass * shapes[j].frequencies**2
        damping[diagonal, diagonal] = shapes[j].modal_mass * modal_damping(link, shapes[j])
        damping[j, j] = robot.drives[j].damping
    return damping, stiffness


@dataclass(frozen=True)
class KinematicRows:
    """
    Rows that give, multiplied by p', the velocities in the kinetic energy; shape (N,) each.

    Attributes
    ----------
    base_1, root_2 : Array
        Rotation rate of the upper and of the lower link's root.
    elbow, elbow_slope : Array
        Velocity of the elbow across the upper link, rotation rate of the elbow's hub.
    tip, tip_slope : Array
        Velocity across the lower link relative to the elbow, and rotation rate, of the tip.
    payload : Array
        Velocity of the payload's centre across the lower link relative to the elbow.
    static_moment_1, static_moment_2 : Array
        int v dm, kg m: over the upper link and all that it carries except the payload, and over
        the lower link alone.

    """

    base_1: Array
    root_2: Array
    elbow: Array
    elbow_slope: Array
    tip: Array
    tip_slope: Array
    payload: Array
    static_moment_1: Array
    static_moment_2: Array

    @classmethod
    def of(cls, robot: Robot, shapes: tuple[Shapes, Shapes], modes: int) -> KinematicRows:
        """Return the rows of an arm whose links bend in the given shapes."""
        upper, lower = robot.links
        q_1, q_2 = link_slice(0, modes), link_slice(1, modes)
        base_1 = np.eye(2 + 2 * modes)[0]
        elbow = (upper.hub_radius + upper.length) * base_1
        elbow[q_1] = shapes[0].shape(upper.length)
        elbow_slope = base_1.copy()
        elbow_slope[q_1] = shapes[0].shape(upper.length, 1)
        root_2 = elbow_slope + np.eye(2 + 2 * modes)[1]
        tip = (lower.hub_radius + lower.length) * root_2
        tip[q_2] += shapes[1].shape(lower.length)
        tip_slope = root_2.copy()
        tip_slope[q_2] += shapes[1].shape(lower.length, 1)
        moments = []
        for link, shape, root, q in zip(robot.links, shapes, (base_1, root_2), (q_1, q_2)):
            row = link.mass * (link.hub_radius + 0.5 * link.length) * root
            row[q] -= shape.modal_mass * shape.beta
            moments.append(row)
        moments[0] = moments[0] + (robot.elbow_mass + lower.mass) * elbow
        payload = tip + robot.payload_offset * tip_slope
        return cls(base_1, root_2, elbow, elbow_slope, tip, tip_slope, payload, *moments)


def _square(row: Array) -> Array:
    return np.outer(row, row)


def _symmetric(a: Array, b: Array) -> Array:
    return np.outer(a, b) + np.outer(b, a)


def _link_mass(robot: Robot, index: int, shapes: tuple[Shapes, Shapes], root: Array) -> Array:
    """Return the mass matrix of rho a int v^2 dx for a link that turns at the rate `root` p'."""
    link, shape = robot.links[index], shapes[index]
    r, length, modes = link.hub_radius, link.length, shape.frequencies.size
    inertia = link.mass * (r * r + r * length + length**2 / 3.0)
    coupling = np.zeros_like(root)
    coupling[link_slice(index, modes)] = -shape.modal_mass * (shape.alpha + r * shape.beta)
    matrix = inertia * _square(root) + _symmetric(root, coupling)
    diagonal = np.arange(root.size)[link_slice(index, modes)]
    matrix[diagonal, diagonal] += shape.modal_mass
    return matrix
