"""Writes the URDF of an arm with rigid links, for robot_state_publisher."""

from __future__ import annotations

import math
from xml.etree import ElementTree

from flex_plant_sim.arm.robot import Robot

# Name of the base frame, that of the topic arm_markers.
BASE = 'base'
LINKS = ('upper', 'lower')
TIP = 'tip'
# Joint speed, rad/s, and torque, N m, that URDF requires as limits if a drive has none.
MAX_SPEED, MAX_TORQUE = 100.0, 1e4
COLOURS = ('0.2 0.4 0.75 1', '0.2 0.65 0.45 1')
# Least moment of inertia, kg m^2: URDF readers refuse zero.
LEAST_INERTIA = 1e-9


def urdf(robot: Robot, prefix: str = '') -> str:
    """
    Return the URDF of an arm at rest: frames base, upper, lower and tip.

    Parameters
    ----------
    robot : Robot
        The robot as in its file.
    prefix : str
        Prefix of the name of every link, and so of every frame; joints keep their names.

    """
    root = ElementTree.Element('robot', name=robot.name)
    _add(root, 'link', name=prefix + BASE)
    x = 0.0
    for j, link in enumerate(robot.links):
        parent = prefix + (BASE if j == 0 else LINKS[0])
        _joint(root, robot, j, parent, prefix + LINKS[j], x)
        _link(root, robot, j, prefix + LINKS[j])
        x = link.hub_radius + link.length
    tip = _add(root, 'joint', name=TIP, type='fixed')
    _add(tip, 'parent', link=prefix + LINKS[1])
    _add(tip, 'child', link=prefix + TIP)
    _add(tip, 'origin', xyz=f'{x:.9g} 0 0')
    _tip(root, robot, prefix + TIP)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding='unicode', xml_declaration=True) + '\n'


def _add(parent: ElementTree.Element, tag: str, /, **attributes: str) -> ElementTree.Element:
    return ElementTree.SubElement(parent, tag, attributes)


def _joint(root: ElementTree.Element, robot: Robot, j: int, parent: str, child: str,
           x: float) -> None:
    low, high = robot.angle_limits[j]
    limited = math.isfinite(low) and math.isfinite(high)
    joint = _add(root, 'joint', name=f'joint_{j + 1}',
                 type='revolute' if limited else 'continuous')
    _add(joint, 'parent', link=parent)
    _add(joint, 'child', link=child)
    _add(joint, 'origin', xyz=f'{x:.9g} 0 0')
    _add(joint, 'axis', xyz='0 0 1')
    drive = robot.drives[j]
    torque = drive.torque_gain * drive.command_limit
    speed = torque / drive.damping if drive.damping else math.inf
    ends = {'lower': f'{low:.9g}', 'upper': f'{high:.9g}'} if limited else {}
    _add(joint, 'limit', effort=f'{min(torque, MAX_TORQUE):.6g}',
         velocity=f'{min(speed, MAX_SPEED):.6g}', **ends)


def _link(root: ElementTree.Element, robot: Robot, j: int, name: str) -> None:
    link = robot.links[j]
    middle = link.hub_radius + 0.5 * link.length
    bodies = [(link.mass, middle, link.mass * link.length**2 / 12.0)]
    if j == 0:
        bodies.append((robot.elbow_mass, link.hub_radius + link.length, robot.elbow_inertia))
    element = _add(root, 'link', name=name)
    _inertial(element, bodies)
    visual = _add(element, 'visual')
    _add(visual, 'origin', xyz=f'{middle:.9g} 0 0')
    _add(_add(visual, 'geometry'), 'box',
         size=f'{link.length:.9g} {link.thickness:.9g} {link.height:.9g}')
    _add(_add(visual, 'material', name=f'{name}_colour'), 'color', rgba=COLOURS[j])


def _tip(root: ElementTree.Element, robot: Robot, name: str) -> None:
    element = _add(root, 'link', name=name)
    _inertial(element, [(robot.payload_mass, robot.payload_offset, robot.payload_inertia)])


def _inertial(link: ElementTree.Element, bodies: list[tuple[float, float, float]]) -> None:
    """Add mass, centre and moments of bodies (mass, place along x, own moment about z)."""
    mass = sum(m for m, _, _ in bodies)
    if mass == 0.0:
        return
    centre = sum(m * x for m, x, _ in bodies) / mass
    moment = sum(own + m * (x - centre)**2 for m, x, own in bodies)
    inertial = _add(link, 'inertial')
    _add(inertial, 'origin', xyz=f'{centre:.9g} 0 0')
    _add(inertial, 'mass', value=f'{mass:.9g}')
    about = f'{max(moment, LEAST_INERTIA):.9g}'
    # A link is thin: its inertia about y equals that about z, and that about x is negligible.
    _add(inertial, 'inertia', ixx=f'{LEAST_INERTIA:.9g}', iyy=about, izz=about, ixy='0', ixz='0',
         iyz='0')
