"""Two paces: one filter takes every sample, a bank of them and the search only marked ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math

from flex_payload_estimator.estimators.rpe.effects import EffectStep
from flex_payload_estimator.estimators.rpe.hypothesis import Sample
from flex_payload_estimator.estimators.rpe.levels import levels, start_spread, told_noise
from flex_payload_estimator.estimators.rpe.parts import gain_columns, tabulated
from flex_payload_estimator.estimators.rpe.settings import RpeSettings
from flex_payload_estimator.estimators.rpe.stepper import Stepper
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

# Marked samples are at least this far apart, s: two dozen filters need a few milliseconds.
MARK_S = 0.01
# Of a drifting payload, heaviest payloads per square root of a second.
DRIFT_SHARE = 0.04


def stepper_of(robot: Robot, model: str, modes: int, effects: Sequence[Effect],
               settings: RpeSettings, stride: int) -> tuple[Stepper, Array]:
    """Return what steps filters by `stride` samples, and the tolerances of its parts, (p,)."""
    robot = replace(robot, sample_time=stride * robot.sample_time)
    arm = ExtendedArm(robot, model, modes, effects=effects)
    heaviest = settings.payload_max or 4.0 * robot.links[1].mass + 2.0 * robot.payload_mass
    bare = replace(robot, effects=(), angle_noise=1.0, strain_noise=1.0)
    schedule, tolerances = tabulated(bare, model, modes, tuple(effects), heaviest)
    told = told_noise(arm)
    # The told torque is held over one sample: the mean of several has less.
    torque = np.asarray(settings.torque_noise) / math.sqrt(stride)
    return Stepper(
        schedule, levels(arm, torque, DRIFT_SHARE * heaviest), told, EffectStep(arm), heaviest,
        gain_columns(told.size, schedule.parameters, tolerances.size), start_spread(arm)
    ), tolerances


class Pace:
    """
    The steppers of either pace, and the commands since the last mark.

    Parameters
    ----------
    robot, model, modes, effects, settings
        See RecursivePredictionError.

    Attributes
    ----------
    stride : int
        Samples from mark to mark.
    fine, coarse : Stepper
        Over one sample, and from mark to mark.
    tolerances : Array
        Of the part parameters, relative, (p,).

    """

    def __init__(self, robot: Robot, model: str, modes: int, effects: Sequence[Effect],
                 settings: RpeSettings):
        self.stride = max(1, math.floor(MARK_S / robot.sample_time + 1e-6))
        self.fine, self.tolerances = stepper_of(robot, model, modes, effects, settings, 1)
        self.coarse = self.fine
        if self.stride > 1:
            self.coarse = stepper_of(robot, model, modes, effects, settings, self.stride)[0]
            if self.coarse.output.shape != self.fine.output.shape:
                # An effect whose states count samples.
                self.stride, self.coarse = 1, self.fine
        for stepper in {self.fine, self.coarse}:
            stepper.warm()
        self.reset()

    @property
    def sample_time(self) -> float:
        """Return the time from sample to sample, s."""
        return self.fine.effects.arm.step_time

    @property
    def mark_time(self) -> float:
        """Return the time from mark to mark, s."""
        return self.coarse.effects.arm.step_time

    def reset(self) -> None:
        """Forget all commands."""
        for stepper in (self.fine, self.coarse):
            stepper.effects.reset()
        self._since: tuple[Array, ...] = ()
        self._before = 0.0

    def save(self) -> tuple[Array, Array, tuple[Array, ...], float]:
        """Return what `restore` needs to come back to now."""
        return (self.fine.effects.history, self.coarse.effects.history, self._since,
                self._before)

    def restore(self, saved: tuple[Array, Array, tuple[Array, ...], float]) -> None:
        """Come back to when `save` was called."""
        (self.fine.effects.history, self.coarse.effects.history, self._since,
         self._before) = saved

    def advance(self, time: float, command: Array, activity: float
                ) -> tuple[Sample, Sample | None]:
        """
        Return a sample to be predicted over, and one since the last mark where this is a mark.

        Parameters
        ----------
        time : float
            s, of the sample.
        command : Array
            Sent up to it, (2,).
        activity : float
            At the sample before.

        """
        applied = self.fine.effects.at_drive(command, time - self.fine.effects.arm.step_time)
        sample = Sample(time, None, applied, activity, activity)
        if self.stride == 1:
            return sample, sample
        self._since += (command,)
        if len(self._since) < self.stride:
            return sample, None
        sent, before = np.array(self._since), self._before
        self._since, self._before = (), activity
        applied = self.coarse.effects.at_drive(sent.mean(axis=0), time - self.mark_time)
        return sample, Sample(time, None, applied, before, activity, sent.std(axis=0))
