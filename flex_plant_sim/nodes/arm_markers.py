"""The bent links and the payload as markers, for RViz or Foxglove."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from geometry_msgs.msg import Point
from msg_config.messages import time_message
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

FRAME = 'base'
# Width of the lines of links, m, and RGB colours, 0 to 1, of links and payload.
LINE_WIDTH = 0.008
COLOURS, PAYLOAD_COLOUR = ((0.20, 0.40, 0.75), (0.20, 0.65, 0.45)), (0.85, 0.35, 0.15)
# A payload is drawn as a sphere of this density, kg/m^3, with at least this radius, m, so that it
# can be seen.
PAYLOAD_DENSITY, SMALLEST_RADIUS = 1000.0, 0.008


def arm_markers(stamp: int, lines: Array, mass: float, space: str = 'arm', prefix: str = ''
                ) -> MarkerArray:
    """
    Return one line strip for each link and a sphere for the payload.

    Parameters
    ----------
    stamp : int
        Stamp of the markers, ns.
    lines : Array
        Centre lines, m, (2, P, 2).
    mass : float
        Payload, kg.
    space : str
        Namespace of the markers, which tells the true arm from the measured one.
    prefix : str
        Before the name of their frame, as that of the URDF.

    """
    markers = [*(_link(stamp, index, line) for index, line in enumerate(lines)),
               _payload(stamp, lines[1, -1], mass)]
    for marker in markers:
        marker.ns, marker.header.frame_id = space, prefix + FRAME
    return MarkerArray(markers=markers)


def _marker(stamp: int, number: int, kind: int, colour: tuple[float, float, float]) -> Marker:
    marker = Marker(id=number, type=kind, action=Marker.ADD)
    marker.header.stamp = time_message(stamp)
    marker.pose.orientation.w = 1.0
    marker.color = ColorRGBA(r=colour[0], g=colour[1], b=colour[2], a=1.0)
    return marker


def _link(stamp: int, index: int, line: Array) -> Marker:
    marker = _marker(stamp, index, Marker.LINE_STRIP, COLOURS[index])
    marker.scale.x = LINE_WIDTH
    marker.points = [Point(x=x, y=y) for x, y in line.tolist()]
    return marker


def _payload(stamp: int, tip: Array, mass: float) -> Marker:
    marker = _marker(stamp, 2, Marker.SPHERE, PAYLOAD_COLOUR)
    marker.pose.position.x, marker.pose.position.y = tip.tolist()
    radius = max(SMALLEST_RADIUS, (0.2387 * mass / PAYLOAD_DENSITY)**(1.0 / 3.0))
    marker.scale.x = marker.scale.y = marker.scale.z = 2.0 * radius
    return marker
