"""
Calibrates the parts of an arm from logs with a known payload: maximum a posteriori, Gauss-Newton.

The residuals are one-step prediction errors of the diagnosis' predictor; every part has the
Gaussian prior of its tolerance around the robot file.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.commissioning.items import calibration_items, Item, with_deviations
from flex_plant_sim.commissioning.residuals import MODEL, Residuals
from flex_plant_sim.commissioning.system import System
from flex_plant_sim.logs.log import Log
from flex_plant_sim.simulation.nominal import nominal_robot
import numpy as np

# Largest number of Gauss-Newton iterations: three times as many as the tutorial's log takes.
ITERATIONS = 12
# Step, in tolerances, below which the iteration has converged; smaller deviations are set to 0.
# Half a minute tells the best-known part of the reference arm to 0.18.
SETTLED = 0.1
# Largest number of halvings of a step: to a thirtieth of it.
HALVINGS = 5
# Parts that are not calibrated, because they belong to the payload, which is known.
KNOWN = ('payload_inertia',)


@dataclass(frozen=True)
class Calibration:
    """
    The result of a calibration.

    Attributes
    ----------
    robot : Robot
        Robot with the calibrated parts; gauge scales and zeros, and the Coriolis forces, are among
        its effects.
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
        Logs with the same sample time.
    robot : Robot
        Its numbers and tolerances are the prior.
    payload : float
        Payload in all logs, kg.
    progress : Callable
        Called with a line of text after each iteration.

    Raises
    ------
    InputError
        A log is too short.

    """
    # The new robot file lists the Coriolis forces that the fit assumes.
    robot = nominal_robot(robot, MODEL)
    told = replace(robot, payload_mass=payload, sample_time=logs[0].sample_time)
    items = [item for item in calibration_items(told) if item.name not in KNOWN]
    residuals = Residuals(logs, told)
    values, before = np.zeros(len(items)), residuals.of(told)
    for iteration in range(ITERATIONS):
        system = System.of(residuals, told, items, values)
        moved = _descent(residuals, told, items, values, system)
        largest = float(np.abs(moved - values).max())
        progress(f'iteration {iteration + 1}: largest step {largest:.2g} tolerances')
        values = moved
        residuals = residuals.around(with_deviations(told, items, values))
        if largest < SETTLED:
            break
    values[np.abs(values) < SETTLED] = 0.0
    std = np.sqrt(np.diagonal(system.covariance))
    found = tuple(replace(item, deviation=float(value * item.tolerance),
                          std=float(deviation * item.tolerance))
                  for item, value, deviation in zip(items, values, std))
    after = residuals.of(with_deviations(told, items, values))
    return Calibration(with_deviations(robot, items, values), found, _rms(before), _rms(after))


def _descent(residuals: Residuals, robot: Robot, items: Sequence[Item], values: Array,
             system: System) -> Array:
    """Return the values after one Gauss-Newton step, halved until the posterior increases."""
    errors = residuals.of(with_deviations(robot, items, values))
    step, height = system.step, system.height(errors, values)
    for _ in range(HALVINGS):
        moved = values + step
        if system.height(residuals.of(with_deviations(robot, items, moved)), moved) < height:
            return moved
        step = 0.5 * step
    return values


def _rms(errors: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(errors**2, axis=(0, 1))))
