"""The quantities that a calibration estimates: parts of an arm, and what its sensors read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import exp

from flex_plant_sim.arm.parts import robot_parts
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.commissioning.residuals import (
    gauge_readings,
    joint_zero,
    with_gauge,
    with_joint_zero,
    ZERO_JOINT,
)


@dataclass(frozen=True)
class Item:
    """
    A quantity to calibrate, with its prior and its estimate.

    Attributes
    ----------
    name : str
    tolerance : float
        Standard deviation of the prior.
    change : Callable
        (robot, deviation) -> robot with that deviation.
    unit : str
        Unit of all deviations; empty where they are the logarithm of true over nominal.
    deviation, std : float
        Estimate and its standard deviation, in the unit of the tolerance.

    """

    name: str
    tolerance: float
    change: Callable[[Robot, float], Robot]
    unit: str = ''
    deviation: float = 0.0
    std: float = 0.0

    def size(self, value: float, sign: str = '') -> str:
        """Return a deviation as text with its unit, or in percent."""
        return f'{value:{sign}.2g} {self.unit}' if self.unit else f'{100.0 * value:{sign}.2f} %'


def calibration_items(robot: Robot) -> tuple[Item, ...]:
    """Return all uncertain quantities: parts, scale and zero of every gauge, joint 2's zero."""
    t, gauges = robot.tolerances, robot.gauge_names
    items = [Item(part.name, part.tolerance, part.change, part.unit)
             for part in robot_parts(robot)]
    items += [Item(f'strain_gain:{gauge}', t.strain_gain, _gauge_scale(k))
              for k, gauge in enumerate(gauges)]
    items += [Item(f'strain_bias:{gauge}', t.strain_bias, _gauge_zero(k), 'm/m')
              for k, gauge in enumerate(gauges)]
    items.append(Item(f'angle_offset:{ZERO_JOINT}', t.angle_zero_rad, _joint_zero, 'rad'))
    return tuple(item for item in items if item.tolerance > 0.0)


def _gauge_scale(k: int) -> Callable[[Robot, float], Robot]:
    def change(robot: Robot, value: float) -> Robot:
        scale, zero = gauge_readings(robot)[k]
        return with_gauge(robot, k, scale * exp(value), zero)

    return change


def _gauge_zero(k: int) -> Callable[[Robot, float], Robot]:
    def change(robot: Robot, value: float) -> Robot:
        scale, zero = gauge_readings(robot)[k]
        return with_gauge(robot, k, scale, zero + value)

    return change


def _joint_zero(robot: Robot, value: float) -> Robot:
    return with_joint_zero(robot, joint_zero(robot) + value)


def with_deviations(robot: Robot, items: Sequence[Item], values: Array) -> Robot:
    """Return the robot with deviations of the items, (p,), in units of their tolerances."""
    for item, value in zip(items, values):
        if value != 0.0:
            robot = item.change(robot, float(value * item.tolerance))
    return robot
