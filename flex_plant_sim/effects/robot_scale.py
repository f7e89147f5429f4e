"""
What sizes are conceivable on a robot: those of the catalogue, by what their units are worth there.

The catalogue's numbers are those of the reference robot. An arm that is like it in all but length
and mass, at the same pace, moves and bends like it: what is wrong with one is as conceivable on
the other if it is scaled as lengths, masses and torques are. What has no dimension of length or
mass (angles, times, strains, factors) is the same on all, and so is the air.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot


def _mass(robot: Robot, site: str) -> float:
    return sum(link.mass for link in robot.links) + robot.elbow_mass


def _inertia(robot: Robot, site: str) -> float:
    reach = sum(link.length + link.hub_radius for link in robot.links)
    return _mass(robot, site) * reach**2


def _damping(robot: Robot, site: str) -> float:
    """Return the torque of a joint at 1 rad/s and 1 rad/s^2: what a loop resists counts, too."""
    return robot.drives[int(site[-1]) - 1].damping + _inertia(robot, site)


def _command(robot: Robot, site: str) -> float:
    """Return the command that asks for such a torque, or the largest that the drive takes."""
    drive = robot.drives[int(site[-1]) - 1]
    return min(_damping(robot, site) / drive.torque_gain, drive.command_limit)


# How large a quantity in each unit is on a robot, at a site, at a pace of a second.
LARGE: dict[str, Callable[[Robot, str], float]] = {
    'kg': _mass, 'kg m^2': _inertia, 'N m': _inertia, 'N m/rad': _inertia,
    'N m s/rad': _damping, 'command unit': _command,
    '1/command unit': lambda robot, site: 1.0 / _command(robot, site),
    'rad/(N m)': lambda robot, site: 1.0 / _inertia(robot, site),
    'm/N': lambda robot, site: 1.0 / _mass(robot, site)}
# Where on the reference robot the catalogue's number is meant, if not at the same site.
MEANT_AT = {'N m s/rad': 'joint_2'}


def robot_scale(unit: str, site: str, robot: Robot) -> float:
    """
    Return by what the catalogue's sizes in a unit are multiplied at a site of a robot.

    Parameters
    ----------
    unit : str
        Of a parameter of an effect.
    site : str
        joint_1, link_2, elbow, arm, a gauge.
    robot : Robot
        Whose lengths, masses and drives count.

    """
    if unit not in LARGE:
        return 1.0
    return LARGE[unit](robot, site) / LARGE[unit](_reference(), MEANT_AT.get(unit, site))


@lru_cache(maxsize=1)
def _reference() -> Robot:
    return load_robot('reference')
