"""Where a gauge stands among the outputs."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import one_hot
from msg_config.errors import InputError


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
