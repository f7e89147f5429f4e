"""What an arm would be like: frequencies, gauge sensitivity, deflection; no motion yet."""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.assumed_modes import assumed_modes, KinematicRows
from flex_plant_sim.arm.ritz import RitzShapes
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.arm.state_space import state_space
import numpy as np
from scipy.linalg import eigh

# cos theta_2 of the straight arm.
STRAIGHT = 1.0


@dataclass(frozen=True)
class Closed:
    """
    A natural mode with the drives working on zero command.

    Attributes
    ----------
    frequency : float
        Hz.
    damping : float
        Damping ratio.

    """

    frequency: float
    damping: float


def locked_modes(robot: Robot, modes: int, payload: float, cosine: float = STRAIGHT
                 ) -> tuple[Array, Array]:
    """
    Return frequencies (Hz, ascending) and shapes with both joints held.

    Parameters
    ----------
    robot : Robot
        As its file says.
    modes : int
        Modes a link.
    payload : float
        kg.
    cosine : float
        Of the elbow's angle.

    Returns
    -------
    tuple of Array
        (2 modes,), and over the flexible coordinates (2 modes, 2 modes), a column each.

    """
    form = assumed_modes(robot, modes)
    mass, stiffness = form.mass_at(cosine, payload), form.stiffness_at(cosine)
    values, vectors = eigh(stiffness[2:, 2:], mass[2:, 2:])
    return np.sqrt(np.maximum(values, 0.0)) / (2.0 * np.pi), vectors


def closed_modes(robot: Robot, modes: int, payload: float) -> tuple[Closed, ...]:
    """Return the modes that swing, elbow straight, with the drives' own damping and inertia."""
    roots = np.linalg.eigvals(state_space(assumed_modes(robot, modes), STRAIGHT, payload).a)
    swinging = sorted(roots[roots.imag > 0.0], key=abs)
    return tuple(Closed(abs(root) / (2.0 * np.pi), -root.real / abs(root)) for root in swinging)


@dataclass(frozen=True)
class TipForce:
    """
    What 1 N across the tip does, arm straight, joints held.

    Attributes
    ----------
    deflection : float
        Of the tip, m/N.
    strain : Array
        At the gauges, 1/N, (gauges,).

    """

    deflection: float
    strain: Array


def tip_force(robot: Robot, modes: int) -> TipForce:
    """Return what a static force of 1 N across the tip does."""
    form = assumed_modes(robot, modes)
    shapes = (RitzShapes.of(robot.links[0].beam(modes)), RitzShapes.of(robot.links[1].beam(modes)))
    rows = KinematicRows.of(robot, shapes, modes)
    across = (rows.tip + STRAIGHT * rows.elbow)[2:]
    bent = np.linalg.solve(form.stiffness_at(STRAIGHT)[2:, 2:], across)
    return TipForce(float(across @ bent), form.strain[:, 2:] @ bent)
