"""Figures of an arm at rest: natural frequencies, gauge sensitivity, deflection of the tip."""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.assumed_modes import assumed_modes, KinematicRows
from flex_plant_sim.arm.ritz import RitzShapes
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.arm.state_space import state_space
import numpy as np
from scipy.linalg import eigh

# cos(theta_2) of the straight arm.
STRAIGHT = 1.0


@dataclass(frozen=True)
class ClosedLoopMode:
    """
    A natural mode of the arm with the drives active at zero command.

    Attributes
    ----------
    frequency : float
        Undamped natural frequency, Hz.
    damping : float
        Damping ratio.

    """

    frequency: float
    damping: float


def locked_modes(robot: Robot, modes: int, payload: float) -> tuple[Array, Array]:
    """
    Return natural frequencies (Hz, ascending) and mode shapes, both joints held, arm straight.

    Parameters
    ----------
    robot : Robot
        The robot as in its file.
    modes : int
        Modes per link.
    payload : float
        kg.

    Returns
    -------
    tuple of Array
        Frequencies, (2 modes,), and shapes over the flexible coordinates, one in each column,
        (2 modes, 2 modes).

    """
    form = assumed_modes(robot, modes)
    mass, stiffness = form.mass_at(STRAIGHT, payload), form.stiffness_at(STRAIGHT)
    values, vectors = eigh(stiffness[2:, 2:], mass[2:, 2:])
    return np.sqrt(np.maximum(values, 0.0)) / (2.0 * np.pi), vectors


def closed_modes(robot: Robot, modes: int, payload: float) -> tuple[ClosedLoopMode, ...]:
    """Return the oscillating modes of the straight arm with the drives' damping and inertia."""
    roots = np.linalg.eigvals(state_space(assumed_modes(robot, modes), STRAIGHT, payload).a)
    swinging = sorted(roots[roots.imag > 0.0], key=abs)
    return tuple(ClosedLoopMode(abs(root) / (2.0 * np.pi), -root.real / abs(root))
                 for root in swinging)


@dataclass(frozen=True)
class TipForce:
    """
    The response to a force across the tip, with the arm straight and the joints held.

    Attributes
    ----------
    deflection : float
        Deflection of the tip, m/N.
    strain : Array
        Strain at the gauges, 1/N, (gauges,).

    """

    deflection: float
    strain: Array


def tip_force(robot: Robot, modes: int) -> TipForce:
    """Return the response to a static force of 1 N across the tip."""
    form = assumed_modes(robot, modes)
    shapes = (RitzShapes.of(robot.links[0].beam(modes)), RitzShapes.of(robot.links[1].beam(modes)))
    rows = KinematicRows.of(robot, shapes, modes)
    across = (rows.tip + STRAIGHT * rows.elbow)[2:]
    bent = np.linalg.solve(form.stiffness_at(STRAIGHT)[2:, 2:], across)
    return TipForce(float(across @ bent), form.strain[:, 2:] @ bent)
