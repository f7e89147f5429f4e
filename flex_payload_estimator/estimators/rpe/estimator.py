"""Recursive prediction error: the default payload estimator, one joint posterior."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import math

from flex_payload_estimator.estimators.base import Estimate, Event, LONGEST_GAP_S
from flex_payload_estimator.estimators.rpe.competition import ModeCompetition
from flex_payload_estimator.estimators.rpe.compiled_step import is_reading
from flex_payload_estimator.estimators.rpe.events import EventLog
from flex_payload_estimator.estimators.rpe.excitation import Excitation
from flex_payload_estimator.estimators.rpe.filter import Filter, Sample
from flex_payload_estimator.estimators.rpe.first_sample import FirstSample
from flex_payload_estimator.estimators.rpe.misfit import no_model_holds
from flex_payload_estimator.estimators.rpe.outliers import OutlierTests
from flex_payload_estimator.estimators.rpe.sensors import Loads
from flex_payload_estimator.estimators.rpe.settings import RpeSettings, stepper_of
from flex_payload_estimator.estimators.rpe.start import StartBank
from flex_plant_sim.arm.models import DEFAULT_MODEL, DEFAULT_MODES
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects import effects_of
from flex_plant_sim.interval import Z95
from msg_config.errors import InputError
import numpy as np

# Where nothing is measured, one set of matrices serves for so long, s, as it does at 100 Hz.
GAP_STEP_S = 0.01
# Share of a stamp's deviation by which the sampling grid follows it: jitter is divided by 4.4, and
# a clock that is 2 % off lags by a fifth of a sample.
STAMP_SHARE = 0.1
# Numbers beyond these are no reading: rad, m/m, and the drive's own unit.
LARGEST_ANGLE, LARGEST_STRAIN, LARGEST_COMMAND = 1e6, 1.0, 1e6
# Random walk of the payload while nothing tells of it, kg per square root of a second: chosen,
# 0.015 kg in a minute.
REST_DRIFT = 2e-3


class RecursivePredictionError:
    """
    A joint posterior of state, payload, parts and gauges, under the mode that predicts best.

    docs/estimator_method.md has the method; modes.py the hypotheses about the model, and
    transitions.py every way from one to another. A sample passes through `update`, which predicts,
    learns and answers, and `conclude`, which steps the trials and decides who is the incumbent.

    Parameters
    ----------
    robot : Robot
        Its noise is where the noise estimate starts; its tolerances are the parts' prior.
    model : str
        'assumed_modes', 'paper' or 'paper_reduced'.
    modes : int
        Modes a link.
    settings : RpeSettings or None
        None takes the defaults.

    Attributes
    ----------
    stepper : FilterStep
    arm : ExtendedArm
        The model, with the robot file's effects.
    payload_max : float
        Largest payload, kg.
    settings : RpeSettings

    """

    def __init__(self, robot: Robot, model: str = DEFAULT_MODEL, modes: int = DEFAULT_MODES,
                 settings: RpeSettings | None = None):
        self.settings = settings or RpeSettings()
        self.stepper = stepper_of(robot, model, modes, effects_of(robot), self.settings)
        self.arm, self.payload_max = self.stepper.effects.arm, self.stepper.payload_max
        self._competition, self._start = ModeCompetition(self.stepper), StartBank(self.stepper)
        self._outliers = OutlierTests(self.stepper)
        self._channels = self.stepper.told_variance.size
        self._largest_command = np.full(2, LARGEST_COMMAND)
        self._largest = np.repeat([LARGEST_ANGLE, LARGEST_STRAIN], (2, self._channels - 2))
        self._warm()

    def _warm(self) -> None:
        """Compile the inner loops, or load them compiled, so that no sample waits for it."""
        self.reset()
        # At rest, and with joints that move, so that the bank begins.
        for k, angle in enumerate((0.0, 0.0, 0.0, 0.1, 0.2)):
            measured = np.repeat([angle, 0.0], (2, self._channels - 2))
            self.prepare(np.zeros(2))
            self.update(self.arm.step_time * k, measured, np.zeros(2))
        self.stepper.drift(self._start.best(), 0.0)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._first = FirstSample(self.stepper.told_variance)
        self._forget()

    def _forget(self) -> None:
        """Forget every sample."""
        self._competition.clear()
        self._start.clear()
        self._outliers.clear()
        self.stepper.effects.drive_input.reset()
        self._log = EventLog()
        self._incumbent: Filter | None = None
        self._excitation = Excitation(self.stepper)
        self._loads = self._excitation.loads
        self._prediction: tuple[Array, Sample, tuple[Array, ...]] | None = None
        self._unconcluded: Sample | None = None
        self._command, self._previous_command, self._time = np.zeros(2), np.zeros(2), math.nan
        mass, channels = 0.5 * self.stepper.payload_max, self._channels
        self._last = Estimate(0.0, mass, mass**2 / 3.0, mass**2 / 3.0, np.zeros(channels),
                              np.full(channels, np.inf), 'not_excited')

    @property
    def events(self) -> Sequence[Event]:
        """Return the payload changes found."""
        self.conclude()
        return tuple(self._log.events)

    @property
    def incumbent(self) -> Filter:
        """Return the filter that gives the estimate; during the start, the likeliest."""
        return self._incumbent or self._start.best()

    @property
    def takes_parts_as_told(self) -> bool:
        """Return whether the mode is `exact`."""
        return not self.incumbent.mode.free_parts

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
        self.conclude()
        # Another layout in memory would be compiled for while the sample waits.
        output, command = np.array(output, dtype=float), np.array(command, dtype=float)
        if output.shape != (self._channels,) or command.shape != (2,):
            raise InputError(f'output, command: expected {self._channels} and 2 numbers, got '
                             f'shapes {output.shape} and {command.shape}')
        sent = is_reading(command, self._largest_command)
        good = sent and math.isfinite(time) and is_reading(output, self._largest)
        if good and self._first.is_off(output):
            self._forget()
        if math.isnan(self._time):
            return self._begin(time, output) if good else self._reject(time)
        if sent:
            self._previous_command, self._command = self._command, command
        if not good:
            self._advance(self._time + self.arm.step_time, None)
            return self._reject(time if math.isfinite(time) else self._time)
        self._advance(time, output)
        return self._estimate(time)

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
        command = np.array(command, dtype=float)
        if math.isnan(self._time) or self._prediction \
                or not is_reading(command, self._largest_command):
            return
        past = self.stepper.effects.drive_input.past
        sample = self._sample(self._time + self.arm.step_time, None, command)
        for f in self._filters():
            self.stepper.predict(f, sample, self._excitation.loads)
        self._prediction = command, sample, past

    def conclude(self) -> None:
        """
        Draw the conclusions of the last sample that its estimate need not wait for.

        Otherwise `update` does, before it takes the next sample: its answers are the same.
        """
        sample, self._unconcluded = self._unconcluded, None
        if sample is None:
            return
        if self._incumbent is None:
            window, start = self._competition.window, self._start
            # An arm that is held while its command rises tells wrongly of what follows.
            if not (start.at_rest or self._excitation.has_moved or start.fits):
                self._competition.clear()
            self._competition.remember(sample, self._loads, self._excitation.excited)
            if start.at_rest:
                window.rest(start.best())
            start.restart_if_noisier(window, sample, self._loads)
            left = start.select(self._excitation.excited)
            for f in left[1:]:
                self._competition.keep(f, sample.time)
            self._incumbent = left[0] if left else None
            return
        self._incumbent = self._competition.advance(self._incumbent, sample, self._loads,
                                                    self._excitation.excited)
        self._log.update(self._competition.reported_change, self._competition.ongoing_change,
                         self._incumbent, sample.time, self.stepper.schedule.soft_mass)

    def _filters(self) -> list[Filter]:
        return self._start.filters if self._incumbent is None else [self._incumbent]

    def _sample(self, time: float, output: Array | None, command: Array) -> Sample:
        applied = self.stepper.effects.drive_input(command, time - self.arm.step_time)
        return Sample(time, output, applied)

    def _begin(self, time: float, output: Array) -> Estimate:
        self._time = time
        self._start.begin(output)
        self._excitation.begin(output)
        sample = Sample(time, output, np.zeros(2))
        for f in self._start.filters:
            self.stepper.correct(f, sample, self._excitation.loads)
        self._unconcluded = sample
        return self._estimate(time)

    def _advance(self, time: float, output: Array | None) -> None:
        """Bring the filters to the time of a sample, across a gap if there is one, and learn."""
        step, predicted = self.arm.step_time, self._take_prediction(time)
        steps = max(round((time - self._time) / step), 1)
        if steps > 1:
            self._cross(steps, output)
        expected = self._time + steps * step
        self._time = expected + STAMP_SHARE * (time - expected)
        self._loads, filters = self._excitation.loads, self._filters()
        sample = predicted._replace(measured=output) if predicted \
            else self._sample(self._time, output, self._command)
        advance = self._advancing(output, predicted is not None)
        for f in filters:
            advance(f, sample, self._loads)
        if self._incumbent is not None:
            self._incumbent, sample, lost = self._outliers.resolve(
                self._incumbent, sample, self._loads)
            if lost:
                self._competition.clear()
        # Loads count from the next sample on, so that a prediction made in advance has them too.
        self._excitation.update(output, self.incumbent, sample)
        # Where the filter at rest does not fit, what it takes for noise may be a motion.
        if self._start.at_rest and (self._excitation.excited or not self._start.fits):
            last, window = filters[0].before_prediction(), self._competition.window
            self._start.leave_rest(last, window, sample, self._loads)
            self._excitation.moments = None
        if not self._excitation.excited:
            self._drift()
        self._unconcluded = sample

    def _cross(self, steps: int, output: Array | None) -> None:
        """Predict across a gap of so many samples, or begin anew after it."""
        if steps * self.arm.step_time > LONGEST_GAP_S:
            for f in self._filters():
                self.stepper.relocate(f, output)
            self._competition.clear()
            return
        for sample in self._missing(steps):
            for f in self._filters():
                self.stepper.predict(f, sample, self._excitation.loads)
            self._competition.predict(sample, self._excitation.loads, self._excitation.excited)

    def _advancing(self, output: Array | None, predicted: bool
                   ) -> Callable[[Filter, Sample, Loads], None]:
        """Return the step that brings a filter to a sample and lets it learn."""
        if predicted:
            return self.stepper.correct
        return self.stepper.predict if output is None else self.stepper.step

    def _missing(self, steps: int) -> Iterator[Sample]:
        """Yield the samples that a gap lacks, several in one while the arm hardly turns."""
        step, effects = self.arm.step_time, self.stepper.effects
        # An error that is constant over the gap is as white noise so many times as large.
        change = self._command - self._previous_command
        variance = steps * (change * change + self._loads.drive)
        most = 1 if effects.moves or effects.memory else max(1, round(GAP_STEP_S / step))
        for done in range(0, steps - 1, most):
            some = min(most, steps - 1 - done)
            yield self._sample(self._time + (done + some) * step, None, self._command)._replace(
                command_variance=variance, steps=some)

    def _take_prediction(self, time: float) -> Sample | None:
        """Return the sample that `prepare` predicted if it is the present one; else undo that."""
        if self._prediction is None:
            return None
        command, sample, past = self._prediction
        self._prediction = None
        if command.tolist() == self._command.tolist() and \
                round((time - self._time) / self.arm.step_time) <= 1:
            return sample
        self.stepper.effects.drive_input.past = past
        for f in self._filters():
            f.undo_prediction()
        return None

    def _drift(self) -> None:
        """Let the payload walk at random at rest, where nothing tells of it."""
        variance = REST_DRIFT**2 * self.arm.step_time
        for f in self._filters():
            self.stepper.drift(f, variance)
        self._excitation.moments = None

    def _estimate(self, time: float) -> Estimate:
        best = self.incumbent
        factor = self._competition.variance_factor(best)
        moments = self._excitation.moments or self.stepper.moments(best)
        if not self._excitation.has_moved:
            # At rest the likelihood tells which payload fits the noise, not which it is.
            mass, variance = self._start.prior_moments
        elif self._incumbent is None:
            mass, variance = self._start.moments()
        else:
            mass, variance = self.stepper.published(best, moments, factor)
        tells = self._excitation.excited and self._incumbent is not None
        cut_by_range = tells and mass + Z95 * math.sqrt(variance) > self.payload_max
        suspect = no_model_holds(best, factor, self.stepper.prior)
        status = 'model_suspect' if suspect or cut_by_range \
            else 'ok' if tells else 'not_excited'
        # To unpack an array takes as long as ten of these lines: it ends in an exception.
        innovations = best.innovations.copy()
        self._last = Estimate(time, mass, variance, best.variance, innovations[0],
                              innovations[1], status)
        return self._last

    def _reject(self, time: float) -> Estimate:
        return self._last._replace(time=time, status='input_rejected')
