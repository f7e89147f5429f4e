"""Equations of the paper, term by term from the text: a second route to arm and estimator."""

from __future__ import annotations

import math
from typing import NamedTuple

from flex_plant_sim.arm.beam import Beam
from flex_plant_sim.arm.drive import Drive
from flex_plant_sim.arm.paper_model import CompactModel, Sign
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
import numpy as np
from scipy.linalg import expm


class DriveConstants(NamedTuple):
    """Constants of theta'' = k_1 u + k_2 M_b + k_3 theta', (32): rad/s^2, 1/(kg m^2), 1/s."""

    k_1: float
    k_2: float
    k_3: float


def constants_33(drive: Drive) -> DriveConstants:
    """Return the constants (33) of a drive."""
    return DriveConstants(drive.torque_gain / drive.inertia, 1.0 / drive.inertia,
                          -drive.damping / drive.inertia)


def paper_residual(robot: Robot, modes: int, theta_2: float, payload: float, state: Array,
                   sign: Sign) -> Array:
    """
    Return left minus right side of (6) and (4), term by term from the text; (2 modes,).

    Parameters
    ----------
    robot : Robot
        Without hub radius.
    modes : int
        n.
    theta_2 : float
        rad.
    payload : float
        m_p, kg.
    state : Array
        Rows p, p', p''; (3, 2 + 2n).
    sign : str
        Sign of M_e in (43).

    """
    upper, lower = (link.beam(modes) for link in robot.links)
    q_1, q_2 = state[:, 2:2 + modes], state[:, 2 + modes:]
    length = robot.links[0].length
    elbow = length * state[2, 0] + upper.shape(length) @ q_1[2]
    elbow_turn = state[2, 0] + upper.shape(length, 1) @ q_1[2]
    stiffness = robot.links[1].bending_stiffness
    moment, shear = (stiffness * lower.shape(0.0, order) @ q_2[0] for order in (2, 3))
    reaction = (shear * np.cos(theta_2)
                + (robot.links[1].mass + payload) * np.sin(theta_2)**2 * elbow)
    flip = 1.0 if sign == 'corrected' else -1.0
    torque = flip * (-robot.elbow_inertia * elbow_turn + moment)
    return np.concatenate([
        _upper(robot, modes, q_1, state[2, 0], elbow, reaction, torque),
        _lower(robot, modes, q_2, payload, state[2, 1] + elbow_turn, elbow * np.cos(theta_2))])


def _left(beam: Beam, damping_ratio: float, q: Array) -> Array:
    """Return the left side of both, from rows q, q', q'': (n,)."""
    omega = beam.frequencies
    return omega**2 * q[0] + 2.0 * damping_ratio * omega / omega[0] * omega * q[1] + q[2]


def _upper(robot: Robot, modes: int, q: Array, turn: float, elbow: float, reaction: float,
           torque: float) -> Array:
    """Return left minus right side of (6), (n,)."""
    link = robot.links[0]
    beam = link.beam(modes)
    tip, slope, mass = beam.shape(link.length), beam.shape(link.length, 1), beam.modal_mass
    right = (beam.alpha * turn - robot.elbow_mass / mass * tip * elbow - reaction / mass * tip
             + slope / mass * torque)
    return _left(beam, link.damping_ratio, q) - right


def _lower(robot: Robot, modes: int, q: Array, payload: float, turn: float, push: float) -> Array:
    """Return left minus right side of (4), (n,): `turn` and `push` are accelerations."""
    link = robot.links[1]
    beam = link.beam(modes)
    tip, share = beam.shape(link.length), payload / beam.modal_mass
    right = (-share * tip * (tip @ q[2]) + (beam.alpha - share * link.length * tip) * turn
             + (beam.beta - share * tip) * push)
    return _left(beam, link.damping_ratio, q) - right


def split_15(robot: Robot, modes: int, theta_2: float, payload: float
             ) -> tuple[Array, Array, Array, Array]:
    """Return A^0, A^m, B^0 and B^m by (15) and (16), Lambda frozen at a payload, kg."""
    form = CompactModel(robot, modes).at(theta_2)
    lam, (m_20, m_2m), (m_50, m_5m) = form.lam(payload), form.m_2, form.m_5
    f = 2 * modes
    n = 2 + 2 * f
    a_0, a_m, b_0, b_m = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, 2)), np.zeros((n, 2))
    a_m[2 + f:, 2 + f:] = lam @ m_2m
    b_m[2:2 + f] = lam @ m_5m
    b_m[2 + f:] = lam @ m_2m @ lam @ m_50 + lam @ m_20 @ lam @ m_5m
    a_0[:2, 2:2 + f], a_0[2:2 + f, 2 + f:] = form.m_6, np.eye(f)
    a_0[2 + f:, 2:2 + f], a_0[2 + f:, 2 + f:] = lam @ form.m_1, lam @ m_20
    # (15) prints Lambda M_5 in the second block of B^0; for (13) it has to be Lambda M_5^0.
    b_0[:2], b_0[2:2 + f] = form.m_7, lam @ m_50
    b_0[2 + f:] = (lam @ m_20 @ lam @ m_50 + payload**2 * lam @ m_2m @ lam @ m_5m
                   + lam @ form.m_4)
    return a_0, a_m, b_0, b_m


def omega_19(a: Array, step: float, terms: int) -> Array:
    """Return Omega by the n' terms of (19), (n, n), for T, s."""
    return sum((np.linalg.matrix_power(a * step, i) / math.factorial(i + 1)
                for i in range(1, terms + 1)), np.eye(len(a)))


def omega_exact(a: Array, step: float) -> Array:
    """Return the limit of (19), the mean of e^{At} over T, s, by an exponential, (n, n)."""
    n = len(a)
    wide = np.block([[a, np.eye(n)], [np.zeros((n, 2 * n))]])
    return expm(wide * step)[:n, n:] / step
