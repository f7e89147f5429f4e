"""
One-step prediction errors of logs as a function of the robot, from the diagnosis' predictor.

The calibration minimises them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import ceil

from flex_plant_sim.arm.robot import EffectSpec, Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.commissioning.summary import locked_modes
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.diagnosis.record.sensor_noise import measurement_noise
from flex_plant_sim.diagnosis.record.windows import Record, Windows
from flex_plant_sim.effects import catalogue, effects_of
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.logs.log import Log
from msg_config.errors import InputError
import numpy as np

# Modes per link and model: the defaults of all tools.
MODES = 3
MODEL = 'assumed_modes'
# Length of a window, in periods of the slowest mode.
PERIODS = 5
# Least number of windows: their 24 blocks (system.py) determine a variance to 30 %.
MIN_WINDOWS = 3


class Residuals:
    """
    Logs cut into windows, and a predictor of one robot through them.

    Parameters
    ----------
    logs : sequence of Log
        Logs of one arm with one payload, that of the robot.
    robot : Robot
        Robot of the predictor, whose trajectory and gain are kept for the residuals of others.

    """

    def __init__(self, logs: Sequence[Log], robot: Robot):
        self._windows = [self._windows_of(log, robot) for log in logs]
        self._noise = [measurement_noise(log.measured) for log in logs]
        self._build_predictors(robot)

    @staticmethod
    def _windows_of(log: Log, robot: Robot) -> Windows:
        record = Record(log.source, log.time - log.time[0], log.command, log.output,
                        robot.payload_mass)
        frequencies, _ = locked_modes(robot, MODES, robot.payload_mass)
        period = ceil(1.0 / (float(frequencies[0]) * log.sample_time))
        length = PERIODS * period
        count = (len(log) - period) // length
        if count < MIN_WINDOWS:
            raise InputError(
                f'{log.source}: expected at least {MIN_WINDOWS * PERIODS + 1} periods of the '
                f'slowest mode, {(MIN_WINDOWS * length + period) * log.sample_time:.1f} s, got '
                f'{len(log) * log.sample_time:.1f} s')
        return Windows(record, period + length * np.arange(count), length, period)

    def _build_predictors(self, robot: Robot) -> None:
        self._robot, base = robot, BaseModel(robot, MODEL, MODES, effects_of(robot))
        self._predictors = [Predictor(base, w, s, for_comparison=True)
                            for w, s in zip(self._windows, self._noise)]

    def around(self, robot: Robot) -> Residuals:
        """Return the residuals of the same logs with the predictor of another robot."""
        other = object.__new__(Residuals)
        other._windows, other._noise = self._windows, self._noise
        other._build_predictors(robot)
        return other

    def of(self, robot: Robot) -> Array:
        """
        Return y - y_predicted of a robot close to this one, with this one's gain, (W, length, m).

        The predictor removes scales and zeros from the gauges. Here the scales are applied again;
        otherwise a large scale would make the errors appear small.
        """
        added = self._gauge_changes(robot)
        errors = np.concatenate([p.innovations(added, robot, p.steady)[0]
                                 for p in self._predictors])
        errors[..., 2:] *= [scale for scale, _ in gauge_readings(robot)]
        return errors

    def _gauge_changes(self, robot: Robot) -> tuple[Effect, ...]:
        """Return the effects, scale and zero, that turn this robot's gauges into another's."""
        changes: list[Effect] = []
        kinds = catalogue()['strain_gain'], catalogue()['strain_bias']
        for name, (old, old_zero), (new, new_zero) in zip(
                robot.gauge_names, gauge_readings(self._robot), gauge_readings(robot)):
            ratio = new / old
            values = (ratio, new_zero - ratio * old_zero)
            changes += [kind(name, (value,)) for kind, value, null in zip(
                kinds, values, (1.0, 0.0)) if value != null]
        return tuple(changes)


def gauge_readings(robot: Robot) -> tuple[tuple[float, float], ...]:
    """Return scale and zero (m/m) of every gauge from the robot's effects."""
    told = {(spec.name, spec.site): next(iter(spec.values.values())) for spec in robot.effects
            if spec.name in ('strain_gain', 'strain_bias')}
    return tuple((told.get(('strain_gain', name), 1.0), told.get(('strain_bias', name), 0.0))
                 for name in robot.gauge_names)


def with_gauge(robot: Robot, k: int, scale: float, zero: float) -> Robot:
    """Return the robot with a scale and a zero, m/m, of gauge k among its effects."""
    name = robot.gauge_names[k]
    others = [spec for spec in robot.effects
              if (spec.name, spec.site) not in (('strain_gain', name), ('strain_bias', name))]
    if scale != 1.0:
        others.append(EffectSpec('strain_gain', name, {'factor': scale}))
    if zero != 0.0:
        others.append(EffectSpec('strain_bias', name, {'bias': zero}))
    return replace(robot, effects=tuple(others))
