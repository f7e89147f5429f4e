"""Recursive prediction error: the default payload estimator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math

from flex_payload_estimator.estimators.base import Estimate
from flex_payload_estimator.estimators.rpe.bank import Ahead, Bank
from flex_payload_estimator.estimators.rpe.events import Event
from flex_payload_estimator.estimators.rpe.hypothesis import Hypothesis, Sample, Weighed
from flex_payload_estimator.estimators.rpe.judge import Judge
from flex_payload_estimator.estimators.rpe.levels import Activity
from flex_payload_estimator.estimators.rpe.pace import Pace
from flex_payload_estimator.estimators.rpe.settings import RpeSettings
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects import effects_of
from flex_plant_sim.effects.base import Effect
from msg_config.errors import InputError
import numpy as np

# A gap longer than this, s, loses the state. A reading of more standard deviations of noise, or a
# command of more than this, is none.
LONGEST_GAP_S = 1.0
LARGEST, LARGEST_COMMAND = 1e9, 1e9
SUSPECT_MISFIT = 2.0


def _within(values: Array, limit: float) -> bool:
    """Tell whether all are finite, and less than a limit; quicker than by NumPy for a few."""
    for value in values.tolist():
        # A comparison with NaN is false.
        if not -limit < value < limit:
            return False
    return True


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
        self.settings = settings or RpeSettings()
        chosen = effects_of(robot) if effects is None else tuple(effects)
        self.pace = Pace(robot, model, modes, chosen, self.settings)
        self.stepper = self.pace.coarse
        self.arm, self.told = self.pace.fine.effects.arm, self.pace.fine.told
        self.bank = Bank(self.stepper, self.pace.tolerances)
        self._judge = Judge(self.pace, self.bank, self.settings)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.bank.clear()
        self.pace.reset()
        self._judge.reset()
        self.rejected, self._lost = 0, False
        self._activity, self._command = Activity(self.arm), np.zeros(2)
        self._ahead: Ahead | None = None
        self._weighed: Weighed | None = None
        # What is left to do: conclusions of the last sample, the prediction of this one.
        self._open = self._due = False
        channels, mass = self.told.size, 0.5 * self.stepper.heaviest
        self._nothing = np.full(channels, np.nan)
        self._last = Estimate(0.0, mass, mass**2 / 3.0, mass**2 / 3.0, np.zeros(channels),
                              np.full(channels, np.inf), 'not_excited')
        self._time: float | None = None

    @property
    def events(self) -> list[Event]:
        """Return the payload changes found; one that later samples refute is taken back."""
        self.conclude()
        return list(self._judge.log.events)

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
        # Another layout in memory would be compiled for while the sample waits.
        self.conclude()
        output, command = np.asarray(output, dtype=float), np.array(command, dtype=float)
        if output.shape != self.told.shape or command.shape != (2,):
            raise InputError(f'output, command: expected {self.told.size} and 2 numbers, got '
                             f'shapes {output.shape} and {command.shape}')
        measured, sent = output / self.told, _within(command, LARGEST_COMMAND)
        good = sent and math.isfinite(time) and _within(measured, LARGEST)
        if self._time is None:
            return self._begin(time, output, measured) if good else self._reject(time)
        if sent:
            self._command = command
        self._predict(time if good else self._time + self.arm.step_time, good)
        if not good:
            self._judge.keep(self._mark)
            return self._reject(time)
        return self._learn(output, measured)

    def conclude(self) -> None:
        """
        Draw the conclusions of the last sample that its estimate need not wait for.

        Otherwise `update` does, before it takes the next sample: its answers are the same.
        """
        if self._open:
            self._open = False
            self._judge.conclude(self._mark)

    def prepare(self, command: Array) -> None:
        """
        Predict while no measurement waits: `update` is then quicker, and its answer the same.

        Parameters
        ----------
        command : Array
            What will have been applied up to the next sample, (2,); where `update` is told
            otherwise, it predicts again.

        """
        self.conclude()
        if self._time is None or self._ahead or not _within(command, LARGEST_COMMAND):
            return
        saved, pace = [(h, h.copy()) for h in self.bank.hypotheses], self.pace.save()
        sample, mark = self._sample, self._mark
        command = np.array(command, dtype=float)
        self._advance(self._time + self.arm.step_time, command)
        weighed = self.pace.fine.weigh(saved[0][0], self._sample) if len(saved) == 1 else None
        self._ahead = Ahead(command, saved, pace, sample, mark, weighed)

    def _predict(self, time: float, good: bool) -> None:
        """Bring every hypothesis to the time of the sample, across a gap if there is one."""
        assert self._time is not None
        step, start = self.arm.step_time, self._time
        steps = max(1, round((time - start) / step))
        self._time = max(time, start) if good else time
        ahead, self._ahead, self._weighed = self._ahead, None, None
        if ahead and steps == 1 and ahead.command.tolist() == self._command.tolist():
            self._weighed = ahead.weighed
            return
        if ahead:
            self.pace.restore(ahead.pace)
            self._sample, self._mark = ahead.sample, ahead.mark
            ahead.restore()
        if steps * step > LONGEST_GAP_S:
            self._lost, activity = True, self._sample.activity
            self._sample = self._mark = Sample(time, None, self._command, activity, activity)
            return
        if steps > 1:
            # A filter that diverges across a gap begins again after it.
            with np.errstate(over='ignore', invalid='ignore'):
                for k in range(1, steps):
                    self._advance(start + k * step, self._command)
                    self._judge.keep(self._mark)
        self._due = good and not self._lost and len(self.bank.hypotheses) == 1
        self._advance(start + step if time <= start else time, self._command)

    def _advance(self, time: float, command: Array) -> None:
        """Predict one sample; a bank, where this is a mark, from the last one on."""
        self._sample, self._mark = self.pace.advance(time, command, self._sample.activity)
        if len(self.bank.hypotheses) == 1:
            if not self._due:
                self.pace.fine.predict(self.bank.hypotheses[0], self._sample)
        elif self._mark:
            for h in self.bank.hypotheses:
                self.stepper.predict(h, self._mark)

    def _begin(self, time: float, output: Array, measured: Array) -> Estimate:
        self.bank.start(measured)
        self._time = time
        self._sample = self._mark = Sample(time, None, np.zeros(2), 0.0, 0.0)
        return self._learn(output, measured)

    def _relocate(self, measured: Array) -> None:
        """Start the state again after a gap, with what is known of the payload."""
        for h in self.bank.hypotheses:
            self.stepper.relocate(h, measured)
        self._judge.forget()
        self._lost, self._weighed = False, None

    def _learn(self, output: Array, measured: Array) -> Estimate:
        """Learn from the sample, a bank only from marks, and say what is known."""
        bank, mark = self.bank, self._mark
        if self._lost:
            self._relocate(measured)
        activity = self._activity.follow(output)
        self._sample = self._sample.with_reading(measured, activity)
        alone = len(bank.hypotheses) == 1
        if alone:
            if self._due:
                self._due = False
                self.pace.fine.step(bank.hypotheses[0], self._sample)
            else:
                self.pace.fine.correct(bank.hypotheses[0], self._sample, self._weighed)
        if mark:
            mark = self._mark = mark.with_reading(measured, activity)
            if not alone:
                self._judge.weigh(mark)
        self._open = True
        if not (mark or alone):
            self._last = replace(self._last, time=self._sample.time, innovation=self._nothing)
            return self._last
        self._last = self._estimate(bank.best())
        return self._last

    def _estimate(self, best: Hypothesis) -> Estimate:
        mass, variance = self.bank.moments()
        status = 'ok' if self._judge.excited else 'not_excited'
        if best.misfit > SUSPECT_MISFIT:
            status = 'model_suspect'
        return Estimate(self._sample.time, mass, variance, best.variance, best.reading[0],
                        best.reading[1], status)

    def _reject(self, time: float) -> Estimate:
        self.rejected += 1
        return replace(self._last, time=time, status='input_rejected')
