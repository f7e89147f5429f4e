"""
Scales the sizes of effects, which the catalogue gives for the reference robot, to other robots.

An arm that differs from the reference robot only in length and mass, and moves at the same pace,
moves and bends like it. An effect is as conceivable on one as on the other if it is scaled like
lengths, masses and torques. Quantities without a dimension of length or mass (angles, times,
strains, factors) are the same on all robots, and so is the density of the air.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot


def _mass(robot: Robot, site: str) -> float:
    return robot.moved_mass


def _reach(robot: Robot, site: str) -> float:
    return sum(link.length + link.hub_radius for link in robot.links)


def _inertia(robot: Robot, site: str) -> float:
    return _mass(robot, site) * _reach(robot, site)**2


def _damping(robot: Robot, site: str) -> float:
    """Return a joint's torque at 1 rad/s and 1 rad/s^2, including that of its velocity loop."""
    return robot.drives[int(site[-1]) - 1].damping + _inertia(robot, site)


def _command(robot: Robot, site: str) -> float:
    """Return the command for the torque of `_damping`, at most the drive's limit."""
    drive = robot.drives[int(site[-1]) - 1]
    return min(_damping(robot, site) / drive.torque_gain, drive.command_limit)


# Size of a quantity in each unit on a robot, at a site, for motion with a time scale of 1 s.
UNIT_SIZES: dict[str, Callable[[Robot, str], float]] = {
    'm': _reach, 'kg': _mass, 'kg m^2': _inertia, 'N m': _inertia, 'N m/rad': _inertia,
    'N m s/rad': _damping, 'command unit': _command,
    '1/command unit': lambda robot, site: 1.0 / _command(robot, site),
    'rad/(N m)': lambda robot, site: 1.0 / _inertia(robot, site),
    'm/N': lambda robot, site: 1.0 / _mass(robot, site)}
# Site of the reference robot for which the catalogue's number is given, if not the same site.
REFERENCE_SITES = {'N m s/rad': 'joint_2'}


def robot_scale(unit: str, site: str, robot: Robot) -> float:
    """
    Return the factor of the catalogue's sizes in a unit at a site of a robot.

    Parameters
    ----------
    unit : str
        Unit of a parameter of an effect.
    site : str
        joint_1, link_2, elbow, arm or a gauge.
    robot : Robot
        The robot, of which lengths, masses and drives matter.

    """
    if unit not in UNIT_SIZES:
        return 1.0
    reference_site = REFERENCE_SITES.get(unit, site)
    return UNIT_SIZES[unit](robot, site) / UNIT_SIZES[unit](_reference(), reference_site)


@lru_cache(maxsize=1)
def _reference() -> Robot:
    return load_robot('reference')
