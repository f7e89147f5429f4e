"""Two links with locked joints in cubic Hermite elements: natural frequencies, root moments."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from truth.beam_elements import BeamMesh

Array = NDArray[np.float64]
ELEMENTS = 20


def mesh(robot: Robot, index: int, elements: int = ELEMENTS) -> BeamMesh:
    """Return the mesh of a link (0 upper, 1 lower)."""
    link = robot.links[index]
    return BeamMesh(link.length, link.density * link.thickness * link.height,
                    link.youngs_modulus * link.height * link.thickness**3 / 12.0, elements)


def locked_arm(robot: Robot, theta_2: float, payload: float) -> tuple[Array, Array]:
    """
    Return mass and stiffness of the arm with both joints locked.

    Degrees of freedom: (w, w') of the upper link's free nodes across it, then of the lower
    link's free nodes across it, in space; the lower link's first node rides on the elbow.
    Along itself the lower link and the payload are rigid.
    """
    upper, lower = mesh(robot, 0), mesh(robot, 1)
    own, total = upper.size - 2, upper.size + lower.size - 4
    place_upper, place_lower = np.zeros((upper.size, total)), np.zeros((lower.size, total))
    place_upper[2:, :own] = np.eye(own)
    elbow, slope = np.eye(total)[own - 2], np.eye(total)[own - 1]
    radius = robot.links[1].hub_radius
    place_lower[0] = np.cos(theta_2) * elbow + radius * slope
    place_lower[1] = slope
    place_lower[2:, own:] = np.eye(lower.size - 2)
    tip, tip_slope = np.eye(total)[-2], np.eye(total)[-1]
    along, held = np.sin(theta_2) * elbow, tip + robot.payload_offset * tip_slope
    mass = (place_upper.T @ upper.mass() @ place_upper
            + place_lower.T @ lower.mass() @ place_lower
            + robot.elbow_mass * np.outer(elbow, elbow)
            + robot.elbow_inertia * np.outer(slope, slope)
            + (robot.links[1].mass + payload) * np.outer(along, along)
            + payload * np.outer(held, held)
            + robot.payload_inertia * np.outer(tip_slope, tip_slope))
    stiffness = (place_upper.T @ upper.stiffness() @ place_upper
                 + place_lower.T @ lower.stiffness() @ place_lower)
    return mass, stiffness


def natural_frequencies(robot: Robot, theta_2: float, payload: float) -> Array:
    """Return the natural frequencies with locked joints, rad/s, ascending."""
    mass, stiffness = locked_arm(robot, theta_2, payload)
    return np.sqrt(eigh(stiffness, mass, eigvals_only=True))
