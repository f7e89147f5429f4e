"""Schedule nodes over those angles of the elbow that a record visits."""

from __future__ import annotations

from flex_plant_sim.arm.schedule import barycentric_weights, chebyshev_nodes
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

# A sensor that is off may put the elbow so much beyond what it reads, rad.
MARGIN = 0.2
# Fewest nodes, and points between them at which interpolation is checked.
FEWEST, CHECKED = 3, 9


def visited_nodes(arm: ExtendedArm, angle: Array) -> Array:
    """
    Return Chebyshev nodes over the cosines of the elbow's angles, (N,), ascending, (K,).

    As few as interpolate the arm's steps there no worse than the arm's own nodes do, which are
    spread over all angles.
    """
    turned = np.cos(np.linspace(np.min(angle) - MARGIN, np.max(angle) + MARGIN, 200))
    low, high = float(turned.min()), float(turned.max())
    points = 0.5 * (low + high) + 0.5 * (high - low) * np.linspace(-0.98, 0.98, CHECKED)
    exact = _over(arm, points).schedule.table
    allowed = np.abs(barycentric_weights(points, arm.nodes) @ arm.schedule.table - exact).max()
    for count in range(FEWEST, arm.nodes.size):
        nodes = 0.5 * (low + high) + 0.5 * (high - low) * chebyshev_nodes(count)
        table = _over(arm, nodes).schedule.table
        if np.abs(barycentric_weights(points, nodes) @ table - exact).max() <= allowed:
            return nodes
    return arm.nodes


def _over(arm: ExtendedArm, nodes: Array) -> ExtendedArm:
    other = arm.at_payload(arm.payload)
    other.nodes = nodes
    return other
