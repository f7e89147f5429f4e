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
from flex_plant_sim.effects import build, catalogue, effects_of
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.logs.log import Log
from msg_config.errors import InputError
import numpy as np

# Modes per link and model: the defaults of all tools.
MODES = 3
MODEL = 'assumed_modes'
# The joint whose zero shows; joint 1 turns the whole arm.
ZERO_JOINT = 'joint_2'
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
        added = self._sensor_changes(robot)
        errors = np.concatenate([p.innovations(added, robot, p.steady)[0]
                                 for p in self._predictors])
        errors[..., 2:] *= [scale for scale, _ in gauge_readings(robot)]
        return errors

    def _sensor_changes(self, robot: Robot) -> tuple[Effect, ...]:
        """Return the effects that turn this robot's sensors into another's."""
        changes = [('angle_offset', ZERO_JOINT, joint_zero(robot) - joint_zero(self._robot), 0.0)]
        for name, (old, old_zero), (new, new_zero) in zip(
                robot.gauge_names, gauge_readings(self._robot), gauge_readings(robot)):
            ratio = new / old
            changes += [('strain_gain', name, ratio, 1.0),
                        ('strain_bias', name, new_zero - ratio * old_zero, 0.0)]
        return tuple(catalogue()[kind].of_size(site, value) for kind, site, value, null in changes
                     if value != null)


def joint_zero(robot: Robot) -> float:
    """Return what joint 2's angle reads with both links in line, rad, from the effects."""
    return sum(_value(spec) for spec in robot.effects
               if (spec.name, spec.site) == ('angle_offset', ZERO_JOINT))


def with_joint_zero(robot: Robot, zero: float) -> Robot:
    """Return the robot with a zero of joint 2's angle, rad, among its effects."""
    others = [spec for spec in robot.effects
              if (spec.name, spec.site) != ('angle_offset', ZERO_JOINT)]
    if zero != 0.0:
        others.append(EffectSpec('angle_offset', ZERO_JOINT, {'offset_rad': zero}))
    return replace(robot, effects=tuple(others))


def _value(spec: EffectSpec) -> float:
    """Return the first parameter of an effect, a number."""
    return float(build(spec).values[0])


def gauge_readings(robot: Robot) -> tuple[tuple[float, float], ...]:
    """Return scale and zero (m/m) of every gauge, from all of the robot's effects in turn."""
    found = dict.fromkeys(robot.gauge_names, (1.0, 0.0))
    for spec in robot.effects:
        scale, zero = found.get(spec.site, (1.0, 0.0))
        if spec.name == 'strain_gain':
            found[spec.site] = scale * _value(spec), zero * _value(spec)
        elif spec.name == 'strain_bias':
            found[spec.site] = scale, zero + _value(spec)
    return tuple(found.values())


def with_gauge(robot: Robot, k: int, scale: float, zero: float) -> Robot:
    """Return the robot with a scale and a zero, m/m, of gauge k among its effects."""
    name = robot.gauge_names[k]
    others = [spec for spec in robot.effects
              if (spec.name, spec.site) not in (('strain_gain', name), ('strain_bias', name))]
    shape = {key: value for spec in robot.effects for key, value in spec.values.items()
             if (spec.name, spec.site) == ('strain_gain', name) and key != 'factor'}
    if scale != 1.0 or shape:
        others.append(EffectSpec('strain_gain', name, {'factor': scale, **shape}))
    if zero != 0.0:
        others.append(EffectSpec('strain_bias', name, {'bias': zero}))
    return replace(robot, effects=tuple(others))
