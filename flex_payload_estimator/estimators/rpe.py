"""Recursive prediction error: the default payload estimator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math

from flex_payload_estimator.estimators.base import Estimate
from flex_payload_estimator.estimators.rpe_bank import Ahead, Bank
from flex_payload_estimator.estimators.rpe_effects import EffectStep
from flex_payload_estimator.estimators.rpe_events import ChangeDetector, Event, EventLog
from flex_payload_estimator.estimators.rpe_hypothesis import Hypothesis, Sample, Stepper
from flex_payload_estimator.estimators.rpe_levels import (
    Activity,
    levels,
    start_spread,
    told_noise,
)
from flex_payload_estimator.estimators.rpe_parts import gain_columns, tabulated
from flex_payload_estimator.estimators.rpe_settings import RpeSettings
from flex_payload_estimator.estimators.rpe_windows import PERSISTENT
from flex_plant_sim.arm_model import Array
from flex_plant_sim.effects import effects_of
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.errors import InputError
from flex_plant_sim.extended_arm import ExtendedArm
from flex_plant_sim.robot import Robot
import numpy as np

# A gap longer than this, s, loses the state. A reading of more standard deviations of noise, or a
# command of more than this, is none.
LONGEST_GAP_S = 1.0
LARGEST, LARGEST_COMMAND = 1e9, 1e9
# What a window must tell about a payload change of a sixth of the heaviest: five sigma.
EXCITED = 25.0
SUSPECT_MISFIT = 2.0
# Of a drifting payload, heaviest payloads per square root of a second.
DRIFT_SHARE = 0.04


def _is_command(command: Array) -> bool:
    # A comparison with NaN is false.
    return bool(np.abs(command).max() < LARGEST_COMMAND)


class RecursivePredictionError:
    """
    Predictors that carry the sensitivity of their state to the payload along.

    A bank of them starts from payloads over the whole range and from four levels of model
    error, and collapses to one (see docs/estimators.md).

    Parameters
    ----------
    robot : Robot
        Its noise is believed at the exact level, its tolerances at the others.
    model : str
        'assumed_modes', 'paper' or 'paper_reduced'.
    modes : int
        Modes a link.
    effects : sequence of Effect or None
        None takes the robot file's.
    settings : RpeSettings or None
        None takes the defaults.

    Attributes
    ----------
    rejected : int
        Samples that were no measurement.

    """

    def __init__(self, robot: Robot, model: str = 'assumed_modes', modes: int = 3,
                 effects: Sequence[Effect] | None = None,
                 settings: RpeSettings | None = None):
        settings = settings or RpeSettings()
        chosen = effects_of(robot) if effects is None else tuple(effects)
        self.settings, self.arm = settings, ExtendedArm(robot, model, modes, effects=chosen)
        heaviest = settings.payload_max or 4.0 * robot.links[1].mass + 2.0 * robot.payload_mass
        bare = replace(robot, effects=(), angle_noise=1.0, strain_noise=1.0)
        schedule, tolerances = tabulated(bare, model, modes, chosen, heaviest)
        self.told, self._effects = told_noise(self.arm), EffectStep(self.arm)
        self.stepper = Stepper(
            schedule, levels(self.arm, np.asarray(settings.torque_noise), DRIFT_SHARE * heaviest),
            self.told, self._effects, heaviest,
            gain_columns(self.told.size, schedule.parameters, tolerances.size),
            start_spread(self.arm))
        self.bank, self._spread = Bank(self.stepper, tolerances), start_spread(self.arm)
        self._block = max(2, round(settings.block_s / self.arm.step_time))
        self.stepper.warm()
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.bank.clear()
        self._effects.reset()
        self.detector = ChangeDetector(self.stepper, self._block, self.settings.event_nats)
        self._log = EventLog(2 * self._block * self.arm.step_time)
        self.rejected = self.samples = 0
        self._activity, self._command = Activity(self.arm), np.zeros(2)
        self._excited, self._lost = False, False
        self._unchanged: Hypothesis | None = None
        self._ahead: Ahead | None = None
        channels, mass = self.told.size, 0.5 * self.stepper.heaviest
        self._last = Estimate(0.0, mass, mass**2 / 3.0, mass**2 / 3.0, np.zeros(channels),
                              np.full(channels, np.inf), 'not_excited')
        self._time: float | None = None

    @property
    def events(self) -> list[Event]:
        """Return the payload changes found; one that later samples refute is taken back."""
        return list(self._log.events)

    def update(self, time: float, output: Array, command: Array) -> Estimate:
        """
        Return the estimate after the sample of a time.

        A sample that is no measurement is rejected: the predictors run on without it, and the
        last estimate is returned with status 'input_rejected'.

        Parameters
        ----------
        time : float
            s; a gap of up to LONGEST_GAP_S is predicted across.
        output : Array
            (theta_1, theta_2, strain…), rad and m/m, (m,).
        command : Array
            Applied up to this sample, (2,).

        Raises
        ------
        InputError
            Wrong number of outputs or commands.

        """
        output, command = np.asarray(output, dtype=float), np.asarray(command, dtype=float)
        if output.shape != self.told.shape or command.shape != (2,):
            raise InputError(f'output, command: expected {self.told.size} and 2 numbers, got '
                             f'shapes {output.shape} and {command.shape}')
        measured, sent = output / self.told, _is_command(command)
        good = sent and math.isfinite(time) and bool(np.abs(measured).max() < LARGEST)
        if self._time is None:
            return self._begin(time, output, measured) if good else self._reject(time)
        if sent:
            self._command = command
        self._predict(time if good else self._time + self.arm.step_time, good)
        if not good:
            self.detector.recent.record(self._sample, self.bank.best())
            return self._reject(time)
        return self._learn(output, measured)

    def prepare(self, command: Array) -> None:
        """
        Predict while no measurement waits: `update` is then quicker, and its answer the same.

        Parameters
        ----------
        command : Array
            What will have been applied up to the next sample, (2,); where `update` is told
            otherwise, it predicts again.

        """
        if self._time is None or self._ahead or not _is_command(command):
            return
        history = self._effects.history
        saved = [(h, h.copy()) for h in self.bank.hypotheses]
        sample = self._sample
        self._advance(self._time + self.arm.step_time, np.array(command, dtype=float))
        self._ahead = Ahead(np.array(command, dtype=float), saved, history, sample)

    def _predict(self, time: float, good: bool) -> None:
        """Bring every hypothesis to the time of the sample, across a gap if there is one."""
        assert self._time is not None
        step, start = self.arm.step_time, self._time
        steps = max(1, round((time - start) / step))
        self._time = max(time, start) if good else time
        ahead, self._ahead = self._ahead, None
        if ahead and steps == 1 and np.array_equal(ahead.command, self._command):
            return
        if ahead:
            self._effects.history, self._sample = ahead.history, ahead.sample
            ahead.restore()
        if steps * step > LONGEST_GAP_S:
            self._lost = True
            return
        for k in range(1, steps + 1):
            self._advance(start + k * step if k < steps or time <= start else time,
                          self._command)
            if k < steps:
                self.detector.recent.record(self._sample, self.bank.best())

    def _advance(self, time: float, command: Array) -> None:
        """Predict one sample."""
        applied = self._effects.at_drive(command, time - self.arm.step_time)
        activity = self._sample.activity
        self._sample = Sample(time, None, applied, activity, activity)
        for h in self.bank.hypotheses:
            self.stepper.predict(h, self._sample)

    def _begin(self, time: float, output: Array, measured: Array) -> Estimate:
        self.bank.start(measured)
        self._time, self._sample = time, Sample(time, None, np.zeros(2), 0.0, 0.0)
        return self._learn(output, measured)

    def _relocate(self, measured: Array) -> None:
        """Start the state again after a gap, with what is known of the payload."""
        for h in self.bank.hypotheses:
            self.stepper.relocate(h, measured)
        self.detector.recent.forget()
        self._lost = False

    def _learn(self, output: Array, measured: Array) -> Estimate:
        """Weigh the sample, look for a change, and say what is known."""
        bank, assumed = self.bank, self._sample
        if self._lost:
            self._relocate(measured)
        self._sample = Sample(assumed.time, measured, assumed.command, assumed.before,
                              self._activity.follow(output[2:]))
        for h in bank.hypotheses:
            self.stepper.correct(h, self._sample)
        bank.prune()
        self._confirm()
        active = bank.best()
        self.detector.recent.record(self._sample, active)
        self.samples += 1
        if bank.decided and not self._change(active) and bank.widen(
                self._spread, self._block // 2, self.detector.recent):
            self.detector.recent.forget()
        if self.samples % self._block == 0:
            self._turn(1 + self.samples // self._block % 2)
        self._last = self._estimate(bank.best())
        return self._last

    def _change(self, active: Hypothesis) -> bool:
        """Look for a change of payload, and let it compete with none."""
        change = self.detector.look(active)
        if change is None:
            return False
        self._log.notice(Event(change.time, self._sample.time, active.mass,
                               change.hypothesis.mass))
        exact = self.stepper.levels[active.level].exact
        self.bank.rival(change.hypothesis, 2 * self._block,
                        5.0 * self.detector.limit(active, exact))
        self._unchanged = active
        self.detector.recent.forget()
        self.detector.quiet(self._block)
        return True

    def _confirm(self) -> None:
        """Take the last event back where no change turns out likelier."""
        if self._unchanged is not None and len(self.bank.hypotheses) == 1:
            if self.bank.hypotheses[0] is self._unchanged:
                self._log.take_back()
                self.detector.recent.forget()
            self._unchanged = None

    def _turn(self, column: int) -> None:
        """Close a block; where it told nothing of the payload, let the payload walk."""
        best, span, now = self.bank.best(), self._block * self.arm.step_time, self._sample.time
        told = best.windows.information[column] * (self.stepper.heaviest / 6.0)**2
        self._excited = bool(told > EXCITED)
        self.bank.lively_blocks += self._excited
        if not self.bank.lively_blocks:
            # At rest the likelihoods compare only how a vague start fits.
            self.bank.level_weights()
        walk = self.settings.rest_drift**2 * span
        for h in self.bank.hypotheses:
            if not self._excited and h.variance < (self.stepper.heaviest / 6.0)**2:
                self.stepper.drift(h, walk)
            self.stepper.turn(h, column)
            step = self.stepper.follow_trend(h)
            if h is best and abs(step) > self.detector.smallest(h):
                self._log.notice(Event(now - PERSISTENT * span, now, h.mass, h.mass + step))
        drifted = self.bank.drifted(best)
        if drifted and abs(best.mass - drifted[1]) > self.detector.smallest(best):
            self._log.notice(Event(drifted[0], now, drifted[1], best.mass))
        self.bank.settle()

    def _estimate(self, best: Hypothesis) -> Estimate:
        mass, variance = self.bank.moments()
        status = 'ok' if self._excited else 'not_excited'
        if best.misfit > SUSPECT_MISFIT:
            status = 'model_suspect'
        return Estimate(
            self._sample.time, mass, variance, best.variance, best.innovation * self.told,
            np.sqrt(best.channel) * self.told, status)

    def _reject(self, time: float) -> Estimate:
        self.rejected += 1
        return replace(self._last, time=time, status='input_rejected')
