"""(4) and (6) of the paper, term by term from the text: a second route to the arm model."""

from __future__ import annotations

from flex_plant_sim.arm.paper_model import Sign
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
import numpy as np


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
    (upper, lower), n = robot.links, modes
    beam_1, beam_2 = upper.beam(n), lower.beam(n)
    tip_1, slope_1 = beam_1.shape(upper.length), beam_1.shape(upper.length, 1)
    tip_2 = beam_2.shape(lower.length)
    mu_1, mu_2 = beam_1.modal_mass, beam_2.modal_mass
    q_1, q_2 = state[:, 2:2 + n], state[:, 2 + n:]
    turn_1, turn_2 = state[2, 0], state[2, 1]
    elbow = upper.length * turn_1 + sum(tip_1[j] * q_1[2, j] for j in range(n))
    elbow_turn = turn_1 + sum(slope_1[j] * q_1[2, j] for j in range(n))
    moment = lower.bending_stiffness * sum(beam_2.shape(0.0, 2)[j] * q_2[0, j] for j in range(n))
    shear = lower.bending_stiffness * sum(beam_2.shape(0.0, 3)[j] * q_2[0, j] for j in range(n))
    reaction = (shear * np.cos(theta_2)
                + (lower.mass + payload) * np.sin(theta_2)**2 * elbow)
    flip = 1.0 if sign == 'corrected' else -1.0
    torque = flip * (-robot.elbow_inertia * elbow_turn + moment)
    rows = []
    for i in range(n):
        zeta = upper.damping_ratio * beam_1.frequencies[i] / beam_1.frequencies[0]
        left = (beam_1.frequencies[i]**2 * q_1[0, i]
                + 2.0 * zeta * beam_1.frequencies[i] * q_1[1, i] + q_1[2, i])
        hub = -robot.elbow_mass / mu_1 * tip_1[i] * elbow
        rows.append(left - (beam_1.alpha[i] * turn_1 + hub - reaction / mu_1 * tip_1[i]
                            + slope_1[i] / mu_1 * torque))
    for i in range(n):
        zeta = lower.damping_ratio * beam_2.frequencies[i] / beam_2.frequencies[0]
        left = (beam_2.frequencies[i]**2 * q_2[0, i]
                + 2.0 * zeta * beam_2.frequencies[i] * q_2[1, i] + q_2[2, i])
        alpha = beam_2.alpha[i] - payload / mu_2 * lower.length * tip_2[i]
        beta = beam_2.beta[i] - payload / mu_2 * tip_2[i]
        kappa = [-payload / mu_2 * tip_2[i] * tip_2[j] for j in range(n)]
        rows.append(left - (sum(kappa[j] * q_2[2, j] for j in range(n))
                            + alpha * (turn_2 + elbow_turn) + beta * elbow * np.cos(theta_2)))
    return np.array(rows)
