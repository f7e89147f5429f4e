"""The places of gauges among the outputs, for effects on sensors."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import one_hot
from msg_config.errors import InputError
import numpy as np
from numpy.typing import NDArray


def gauge_row(robot: Robot, site: str) -> Array:
    """
    Return the unit vector of a gauge over (theta_1, theta_2, strain…), (m,).

    Raises
    ------
    InputError
        The robot has no such gauge.

    """
    if site not in robot.gauge_names:
        raise InputError(f'effects: site: expected one of {", ".join(robot.gauge_names)}, '
                         f'got {site!r}')
    return one_hot(robot.output_names.index(site), len(robot.output_names))


def gauge_places(robot: Robot, site: str) -> NDArray[np.intp]:
    """
    Return the places of a site's gauges among all gauges, (g,).

    Parameters
    ----------
    robot : Robot
        The robot that has the gauges.
    site : str
        A gauge, a link (all its gauges) or the arm (all gauges).

    """
    if site == 'arm':
        return np.arange(len(robot.gauge_names))
    upper = len(robot.links[0].gauge_positions)
    if site.startswith('link_'):
        return np.arange(upper) if site == 'link_1' else np.arange(upper, len(robot.gauge_names))
    return np.flatnonzero(gauge_row(robot, site)[2:])
