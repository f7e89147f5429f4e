"""Where a gauge stands among the outputs."""

from __future__ import annotations

from flex_plant_sim.arm_model import Array
from flex_plant_sim.effects.base import one_hot
from flex_plant_sim.errors import InputError
from flex_plant_sim.robot import Robot


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
