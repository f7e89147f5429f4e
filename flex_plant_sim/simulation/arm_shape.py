"""
The bent links as lines in the plane, computed from the coordinates p, for markers and plots.

The node plant_sim and the report draw the arm with it.
"""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.ritz import RitzShapes
from flex_plant_sim.arm.second_order import Array, link_slice
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

# Number of points of a centre line; its chords then deviate from a bent link by 0.1 % of the
# deflection.
POINTS = 21


@dataclass(frozen=True)
class ArmShape:
    """
    Centre lines of both links as functions of p.

    Attributes
    ----------
    along : Array
        Distance of the points from the joint axis along the undeformed link, m, (2, P). The first
        point is the axis itself, so that a rigid hub appears as the first line segment.
    deflection : tuple of Array
        phi_i at those points, (P, n) for each link.
    tip_slope : Array
        phi_i' at the upper link's end, 1/m, (n,).

    """

    along: Array
    deflection: tuple[Array, Array]
    tip_slope: Array

    @classmethod
    def of(cls, arm: ExtendedArm, points: int = POINTS) -> ArmShape:
        """Return the shape functions of an arm's model."""
        along, deflection, slopes = [], [], []
        for link in arm.robot.links:
            beam = link.beam(arm.modes)
            shapes = RitzShapes.of(beam) if arm.model_name == 'assumed_modes' else beam
            x = np.linspace(0.0, link.length, points - 1)
            along.append(np.concatenate([[0.0], link.hub_radius + x]))
            deflection.append(np.vstack([np.zeros(arm.modes), shapes.shape(x)]))
            slopes.append(shapes.shape(link.length, 1))
        return cls(np.array(along), (deflection[0], deflection[1]), slopes[0])

    def lines(self, position: Array) -> Array:
        """
        Return the centre lines for p (N,) or longer: (2, P, 2), x and y in m, joint 1 at 0.

        Deflections are perpendicular to the undeformed link, as in the small-deflection model.
        """
        q_1, q_2 = (position[link_slice(j, self.tip_slope.size)] for j in (0, 1))
        upper = _placed(self.along[0], self.deflection[0] @ q_1, position[0])
        direction = position[0] + self.tip_slope @ q_1 + position[1]
        lower = upper[-1] + _placed(self.along[1], self.deflection[1] @ q_2, direction)
        return np.array([upper, lower])


def _placed(along: Array, across: Array, angle: float) -> Array:
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([cosine * along - sine * across, sine * along + cosine * across], axis=-1)
