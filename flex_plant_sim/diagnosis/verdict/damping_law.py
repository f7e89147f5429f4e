"""
What a damping ratio that does not change with frequency would look like in a link's damping.

The model's ratio grows with frequency, as Kelvin's and Voigt's does; the file tells it of the bare
link. With elbow, lower link and payload at its end a link swings slower, and is damped less. Many
metals keep their ratio, so that the arm seems to have more damping than its links.
"""

from __future__ import annotations

from flex_plant_sim.arm.assumed_modes import assumed_modes
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import link_slice
from flex_plant_sim.diagnosis.verdict.results import Cause
import numpy as np
from scipy.linalg import eigh

# Shapes a link; elbow angle at which the two links bend together, rad.
MODES, ELBOW = 3, 1.0


def constant_ratio_factor(robot: Robot, index: int) -> float:
    """
    Return the factor on a link's damping by which a constant ratio would look like it.

    It is the frequency of the bare link over that of the slowest mode, with joints held, in which
    the link (index 0 or 1) has most of the elastic energy.
    """
    form, cosine = assumed_modes(robot, MODES), np.cos(ELBOW)
    stiffness = form.stiffness_at(cosine)[2:, 2:]
    squares, shapes = eigh(stiffness, form.mass_at(cosine, robot.payload_mass)[2:, 2:])
    own = np.zeros(2 + 2 * MODES)
    own[link_slice(index, MODES)] = 1.0
    energy = np.einsum('ik,ij,jk->k', shapes * own[2:, None], stiffness, shapes)
    mode = int(np.argmax(energy > 0.5 * squares))
    return float(robot.links[index].beam(1).frequencies[0] / np.sqrt(squares[mode]))


def with_damping_law(cause: Cause, robot: Robot) -> str:
    """Return a cause's sentence; of a damping, whether a constant ratio would look like it."""
    if cause.name != 'modal_damping':
        return cause.sentence
    factor, = cause.parameters
    constant = constant_ratio_factor(robot, cause.effect.index)
    if not factor.low <= constant <= factor.high:
        return cause.sentence
    return (f'{cause.sentence} A damping ratio that is the same at all frequencies, as of many '
            f'metals, would give a factor of about {constant:.2g}.')
