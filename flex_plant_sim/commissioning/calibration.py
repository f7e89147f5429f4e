"""
Parts of an arm from logs with a known payload: maximum a posteriori, by Gauss-Newton.

The residuals are one-step prediction errors of the diagnosis' predictor; every part has the
Gaussian prior of its tolerance around the robot file.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.commissioning.items import changed, Item, items_of
from flex_plant_sim.commissioning.residuals import MODEL, Residuals
from flex_plant_sim.commissioning.system import System
from flex_plant_sim.logs.log import Log
from flex_plant_sim.simulation.nominal import nominal_robot
import numpy as np

# The tutorial's log takes four.
ITERATIONS = 12
# Of a tolerance: a smaller step, or a smaller change of the file, is not worth making.
SETTLED = 0.1
# To a thirtieth of a step.
HALVINGS = 5
# Belongs to the payload, which is known.
KNOWN = ('payload_inertia',)


@dataclass(frozen=True)
class Calibration:
    """
    What logs told of a robot.

    Attributes
    ----------
    robot : Robot
        With the parts that the logs tell; gauge scales and zeros, and the Coriolis forces, are
        among its effects.
    items : tuple of Item
    before, after : Array
        Root mean square one-step prediction error of each channel, (m,).

    """

    robot: Robot
    items: tuple[Item, ...]
    before: Array
    after: Array


def calibrate(logs: Sequence[Log], robot: Robot, payload: float,
              progress: Callable[[str], None] = lambda words: None) -> Calibration:
    """
    Return the most probable parts, given logs in which the payload is known.

    Parameters
    ----------
    logs : sequence of Log
        At the same sample time.
    robot : Robot
        The prior: its numbers and tolerances.
    payload : float
        kg, in all logs.
    progress : Callable
        Told what was done.

    Raises
    ------
    InputError
        A log too short.

    """
    # The file names the forces that the fit reckoned with.
    robot = nominal_robot(robot, MODEL)
    told = replace(robot, payload_mass=payload, sample_time=logs[0].sample_time)
    items, residuals = [i for i in items_of(told) if i.name not in KNOWN], Residuals(logs, told)
    values, before = np.zeros(len(items)), residuals.of(told)
    for iteration in range(ITERATIONS):
        system = System.of(residuals, told, items, values)
        moved = _descent(residuals, told, items, values, system)
        largest = float(np.abs(moved - values).max())
        progress(f'iteration {iteration + 1}: largest step {largest:.2g} tolerances')
        values = moved
        residuals = residuals.around(changed(told, items, values))
        if largest < SETTLED:
            break
    values[np.abs(values) < SETTLED] = 0.0
    std = np.sqrt(np.diagonal(system.covariance))
    found = tuple(replace(item, deviation=float(value * item.tolerance),
                          std=float(deviation * item.tolerance))
                  for item, value, deviation in zip(items, values, std))
    after = residuals.of(changed(told, items, values))
    return Calibration(changed(robot, items, values), found, _rms(before), _rms(after))


def _descent(residuals: Residuals, robot: Robot, items: Sequence[Item], values: Array,
             system: System) -> Array:
    """Return the values after one Gauss-Newton step, halved while it leads uphill."""
    step, height = system.step, system.height(residuals.of(changed(robot, items, values)), values)
    for _ in range(HALVINGS):
        moved = values + step
        if system.height(residuals.of(changed(robot, items, moved)), moved) < height:
            return moved
        step = 0.5 * step
    return values


def _rms(errors: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(errors**2, axis=(0, 1))))
