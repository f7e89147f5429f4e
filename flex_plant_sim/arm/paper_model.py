"""
The paper's arm model: (1)-(7), corrected, and the compact form with reduced actuators (10)-(16).

It turns a robot with clamped-free modes into the second-order form, or into a state space.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from flex_plant_sim.arm.assumed_modes import elastic_and_drive_terms, KinematicRows
from flex_plant_sim.arm.beam import Beam
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import (
    angle_rows,
    Array,
    coordinate_names,
    link_slice,
    SecondOrderForm,
    strain_rows,
)
from flex_plant_sim.arm.state_space import StateSpace
from msg_config.errors import InputError
import numpy as np
from numpy.typing import ArrayLike

Sign = Literal['corrected', 'as_printed']


def paper_model(robot: Robot, modes: int, sign: Sign = 'corrected') -> SecondOrderForm:
    """
    Return (3)-(7) with the full actuators (32) in second-order form (not symmetric).

    Each modal row is multiplied by mu_j. The lower link acts on the upper one through the shear
    F_b2 = E I_2 sum phi_2'''(0) q_2, (7), and the root moment M_b2 = E I_2 sum phi_2''(0) q_2.

    Parameters
    ----------
    robot : Robot
        Its payload mass is not used: the form is affine in it.
    modes : int
        Number of modes per link, n.
    sign : str
        'as_printed' keeps the paper's sign of M_e in (43). The elbow's rotary inertia and root
        moment then act with the wrong sign, and the arm is unstable.

    """
    blocks = PaperBlocks(robot, modes, sign)
    order = 2 + 2 * modes
    mass, payload = np.zeros((3, order, order)), np.zeros((3, order, order))
    damping, stiffness = elastic_and_drive_terms(robot, blocks.beams, modes)
    q_1, q_2 = link_slice(0, modes), link_slice(1, modes)
    mass[0, [0, 1], [0, 1]] = [drive.inertia for drive in robot.drives]
    stiffness[0, 0, q_1] -= blocks.root_moment[0]
    stiffness[0, 1, q_2] -= blocks.root_moment[1]
    mass[0, q_1], payload[0, q_1] = blocks.upper_mass
    mass[2, q_1], payload[2, q_1] = -blocks.upper_axial[0], -blocks.upper_axial[1]
    mass[0, q_1] += blocks.upper_axial[0]
    payload[0, q_1] += blocks.upper_axial[1]
    stiffness[0, q_1, q_2] -= blocks.upper_moment
    stiffness[1, q_1, q_2] += blocks.upper_shear
    mass[0, q_2], payload[0, q_2] = blocks.lower_mass
    mass[1, q_2], payload[1, q_2] = blocks.lower_across
    inputs = np.zeros((order, 2))
    inputs[[0, 1], [0, 1]] = [drive.torque_gain for drive in robot.drives]
    rows = blocks.rows
    return SecondOrderForm(
        mass, payload, damping, stiffness, inputs, np.eye(order, 2), angle_rows(modes),
        strain_rows(robot, blocks.beams, modes), coordinate_names(modes),
        elbow_angle=rows.root_2 - rows.base_1,
        field=np.array([[rows.static_moment_1, rows.elbow],
                        [rows.static_moment_2, rows.payload]]))


class PaperBlocks:
    """
    The terms of (4) and (6), multiplied by mu_j, as rows over the coordinates p.

    Pairs are (part without payload, part per kilogram of payload).
    """

    def __init__(self, robot: Robot, modes: int, sign: Sign):
        upper, lower = robot.links
        self.beams = upper.beam(modes), lower.beam(modes)
        self.rows = rows = KinematicRows.of(robot, self.beams, modes)
        q_1, q_2 = link_slice(0, modes), link_slice(1, modes)
        flip = 1.0 if sign == 'corrected' else -1.0
        self.root_moment = [
            link.bending_stiffness * (beam.shape(0.0, 2) - link.hub_radius * beam.shape(0.0, 3))
            for link, beam in zip(robot.links, self.beams)]
        shear = lower.bending_stiffness * self.beams[1].shape(0.0, 3)
        tip_1, slope_1 = self.beams[0].shape(upper.length), self.beams[0].shape(upper.length, 1)
        tip_2, slope_2 = self.beams[1].shape(lower.length), self.beams[1].shape(lower.length, 1)
        payload_2 = tip_2 + robot.payload_offset * slope_2
        self.upper_mass = (
            _link_inertia(self.beams[0], upper.hub_radius, rows.base_1, q_1)
            + robot.elbow_mass * np.outer(tip_1, rows.elbow)
            + flip * robot.elbow_inertia * np.outer(slope_1, rows.elbow_slope),
            np.zeros((modes, rows.elbow.size)))
        self.upper_axial = lower.mass * np.outer(tip_1, rows.elbow), np.outer(tip_1, rows.elbow)
        self.upper_shear = np.outer(tip_1, shear)
        self.upper_moment = flip * np.outer(slope_1, self.root_moment[1])
        self.lower_mass = (
            _link_inertia(self.beams[1], lower.hub_radius, rows.root_2, q_2)
            + robot.payload_inertia * np.outer(slope_2, rows.tip_slope),
            np.outer(payload_2, rows.payload))
        self.lower_across = (
            -self.beams[1].modal_mass * np.outer(self.beams[1].beta, rows.elbow),
            np.outer(payload_2, rows.elbow))


def _link_inertia(beam: Beam, radius: float, root: Array, q: slice) -> Array:
    """Return the rows of mu (q'' - (alpha + r beta) theta'') for a clamp at hub radius r, m."""
    rows = -beam.modal_mass * np.outer(beam.alpha + radius * beam.beta, root)
    rows[:, q] += beam.modal_mass * np.eye(rows.shape[0])
    return rows


@dataclass(frozen=True)
class CompactForm:
    """
    The matrices of (10) and (11) at one theta_2; the pairs are (M^0, M^m) of (14).

    q'' = M_1 q + M_2 q' + M_3 q'' + M_4 u + M_5 u',  theta' = M_6 q + M_7 u,
    with q (2n,), theta (2,), u (2,).
    """

    m_1: Array
    m_2: tuple[Array, Array]
    m_3: tuple[Array, Array]
    m_4: Array
    m_5: tuple[Array, Array]
    m_6: Array
    m_7: Array

    def at(self, name: str, payload: float) -> Array:
        """Return M_2, M_3 or M_5 (name 'm_2', 'm_3' or 'm_5') for a payload, kg, (14)."""
        base, slope = getattr(self, name)
        return base + payload * slope

    def lam(self, payload: float) -> Array:
        """Return Lambda = (I - M_3)^-1, (2n, 2n)."""
        m_3 = self.at('m_3', payload)
        return np.asarray(np.linalg.inv(np.eye(len(m_3)) - m_3), dtype=np.float64)

    def state_space(self, payload: float) -> tuple[Array, Array]:
        """
        Return A (2+4n, 2+4n) and B (2+4n, 2), (12).

        The state is (theta, q, q' - Lambda M_5 u).
        """
        size, lam = len(self.m_1), self.lam(payload)
        m_2, m_5 = self.at('m_2', payload), self.at('m_5', payload)
        a = np.zeros((2 + 2 * size, 2 + 2 * size))
        a[:2, 2:2 + size] = self.m_6
        a[2:2 + size, 2 + size:] = np.eye(size)
        a[2 + size:, 2:2 + size] = lam @ self.m_1
        a[2 + size:, 2 + size:] = lam @ m_2
        jump = lam @ m_5
        b = np.vstack([self.m_7, jump, lam @ m_2 @ jump + lam @ self.m_4])
        return a, b


class CompactModel:
    """
    The compact form of one robot at any theta_2 (Appendix F).

    Raises
    ------
    InputError
        A drive has no damping, by which the reduced actuators divide.

    """

    def __init__(self, robot: Robot, modes: int, sign: Sign = 'corrected'):
        self.modes = modes
        self.form = paper_model(robot, modes, sign)
        damping = np.array([drive.damping for drive in robot.drives])
        if not np.all(damping > 0.0):
            raise InputError('model: paper_reduced divides by the damping of each drive, expected '
                             f'more than 0 N m s/rad, got {damping.min():g}')
        blocks = PaperBlocks(robot, modes, sign)
        self.p_2 = blocks.root_moment[0] / damping[0]
        self.p_4 = blocks.root_moment[1] / damping[1]
        self.p_1, self.p_3 = (drive.torque_gain / drive.damping for drive in robot.drives)
        self.m_6, self.m_7 = np.zeros((2, 2 * modes)), np.diag([self.p_1, self.p_3])
        self.m_6[0, :modes], self.m_6[1, modes:] = self.p_2, self.p_4
        self.mu = np.repeat([beam.modal_mass for beam in blocks.beams], modes)[:, None]

    def at(self, theta_2: float) -> CompactForm:
        """
        Return M_1…M_7 at theta_2, rad, from the rows of (61)-(64) divided by mu.

        M_4 = P_14 vanishes: with the reduced actuators k_21 u_2 + k_23 theta_2' = -k_22 M_b2.
        """
        return self.at_cosine(float(np.cos(theta_2)))

    def at_cosine(self, cosine: float) -> CompactForm:
        """Return the compact form at c = cos(theta_2)."""
        mu, m_6, m_7 = self.mu, self.m_6, self.m_7
        mass = (self.form.mass_at(cosine, 0.0)[2:] / mu,
                self.form.payload_mass_at(cosine)[2:] / mu)
        m_2 = [-part[:, :2] @ m_6 for part in mass]
        m_2[0] = m_2[0] - self.form.damping[2:, 2:] / mu
        m_3 = (np.eye(len(mu)) - mass[0][:, 2:], -mass[1][:, 2:])
        m_5 = (-mass[0][:, :2] @ m_7, -mass[1][:, :2] @ m_7)
        m_1 = -self.form.stiffness_at(cosine)[2:, 2:] / mu
        return CompactForm(m_1, (m_2[0], m_2[1]), m_3, np.zeros((len(mu), 2)), m_5, m_6, m_7)

    def plant(self, cosine: ArrayLike, payload: float) -> StateSpace:
        """Return the reduced state space (12)-(16), (17) at c (…,), without force inputs."""
        points = np.asarray(cosine, dtype=float)
        pairs = [self.at_cosine(float(c)).state_space(payload) for c in points.ravel()]
        a = np.stack([pair[0] for pair in pairs]).reshape(points.shape + pairs[0][0].shape)
        b = np.stack([pair[1] for pair in pairs]).reshape(points.shape + pairs[0][1].shape)
        output = np.vstack([self.form.angle, self.form.strain])
        c = np.hstack([output, np.zeros((len(output), 2 * self.modes))])
        return StateSpace(a, b, np.zeros(points.shape + (len(c.T), 0)),
                          np.broadcast_to(c, points.shape + c.shape))
