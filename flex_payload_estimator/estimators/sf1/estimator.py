"""
The paper's payload estimator: predictor (23), regression (25)-(28), SF1 (29).

One `update` a sample takes outputs and command and returns the payload. The prediction is in
`joint.py`, the regression in `regression.py`; this file holds their sequence.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Any

from flex_payload_estimator.estimators.base import (
    Estimate,
    Event,
    is_finite,
    largest_payload,
    LONGEST_GAP_S,
)
from flex_payload_estimator.estimators.sf1.composite import CompositeMeasurement
from flex_payload_estimator.estimators.sf1.joint import at_start, moved, Track
from flex_payload_estimator.estimators.sf1.regression import (
    MEMORY,
    predict_and_take_sample,
    SF1Constants,
    SF1State,
    SIGNIFICANT,
    take_sample,
)
from flex_payload_estimator.estimators.sf1.settings import (
    check_usable,
    DEFAULT_SETTINGS,
    Pace,
    PAPER_STEP,
    SF1EstimatorSettings,
)
from flex_payload_estimator.kalman.predictor import INITIAL_VARIANCE
from flex_payload_estimator.kalman.riccati import settled
from flex_payload_estimator.model.delta import delta_model, DeltaOperator, halvings_for, TERMS
from flex_payload_estimator.model.payload_model import payload_model
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from msg_config.errors import InputError
import numpy as np

# Mean squared ratio of innovations to their stated standard deviation above which the model is
# suspect: at twice the stated deviation the threshold SIGNIFICANT means little.
SUSPECT = SIGNIFICANT
# Mean absolute deviation of a Gaussian, in standard deviations.
MEAN_DEVIATION = math.sqrt(2.0 / math.pi)
# Stands for the measurement where the predictor has none to correct by.
NO_SAMPLE: Array = np.zeros(0)


class SF1Estimator:
    """
    SF1 on a delta model (section 4.1).

    It regresses on one composite measurement and one step, so it needs as many gauges on a link
    as modes: with more modes the gauges do not determine theta_2e, and the estimate would settle
    on a wrong payload.

    Parameters
    ----------
    robot : Robot
        The arm; its payload mass is not used.
    model : str
        'paper_reduced', 'paper' or 'assumed_modes'; regression 'paper' needs the first.
    modes : int
        Modes per link.
    settings : SF1EstimatorSettings

    Raises
    ------
    InputError
        More modes than gauges on a link, or a model that the regression cannot use.

    """

    def __init__(self, robot: Robot, model: str, modes: int,
                 settings: SF1EstimatorSettings = DEFAULT_SETTINGS):
        check_usable(robot, model, modes, settings)
        self.robot, self.settings, self.step = robot, settings, robot.sample_time
        self.model = payload_model(robot, model, modes)
        self.pace = Pace.of(self.step, settings.regression)
        self.composite = CompositeMeasurement.end_point(self.model)
        self._resolvent = settings.regression == 'resolvent'
        self._columns = np.ascontiguousarray(self.model.output.T)
        terms, radius = settings.terms, self.model.radius
        halvings = halvings_for(radius, self.step, terms) if settings.exact else 0
        self._room = DeltaOperator(self.model.states, self.step, terms, halvings).room
        sensors = np.full(len(self.model.scale), robot.strain_noise)
        sensors[:2] = robot.angle_noise
        self._sensors = np.square(self.model.scale * sensors)
        self._tune()
        self.reset()
        for _ in range(3 * self.pace.samples):
            # Compiles the loops, so that no sample waits for that.
            self.update(0.0, np.zeros(len(self.model.scale)), np.zeros(2))
        self.reset()

    def _tune(self) -> None:
        """Convert the constants of (30) to this sampling interval."""
        given, share = self.settings, self.pace.share
        # R_1 enters once per regression, as in (30). Added in smaller parts it would be another
        # noise, because the arm turns deflections into rates between them.
        self._process = given.r_1 * share / self.step * np.eye(self.model.states)
        self._no_process = 0.0 * self._process
        measurement = given.r_2 / share * np.eye(len(self.model.scale))
        self._measurement = self.step * measurement
        weights, pace = self.composite.weights, self.pace.samples * self.step
        self._constants = tuple(SF1Constants(
            weights, np.append(self.composite.row, 0.0),
            np.ascontiguousarray(self.model.output),
            np.pad(self.model.output, ((0, 0), (0, 1))), self._sensors, self.model.scale,
            float(weights**2 @ self._sensors), given.r_2 / share * float(weights @ weights),
            self._settled_noise(), given.sf1.alpha_0 * share, given.sf1.alpha_1,
            self.payload_max, given.sf1.variance_0,
            min(1.0, pace / MEMORY), min(1.0, self.step / MEMORY), self._resolvent))

    def _settled_noise(self) -> float:
        """
        Return the variance that the composite innovation settles to by (30), rad^2.

        The arm is straight and carries no payload.
        """
        if not self._resolvent:
            return 1.0
        a, b = self.model.matrices(1.0, 0.0)
        a_bar, _ = delta_model(a, b, PAPER_STEP,
                               halvings_for(self.model.radius, PAPER_STEP, TERMS))
        r_1, r_2 = self.settings.r_1, self.settings.r_2
        _, p = settled(a_bar.T, self._columns, r_1 / PAPER_STEP * np.eye(len(a)),
                       r_2 * PAPER_STEP * np.eye(len(self.model.scale)), PAPER_STEP)
        row, weights = self.composite.row, self.composite.weights
        return float(row @ p @ row + r_2 * weights @ weights)

    def reset(self) -> None:
        """Go back to the start: forget state and payload."""
        given = self.settings.sf1
        self.known = SF1State(given.mass_0, given.p_0, given.variance_0, 1.0, 0.0, 1.0, 1.0,
                              1.0)
        self.track: Track | None = None
        self._tracks: tuple[Track, ...] = ()
        self._measured, self._command, self._angle = NO_SAMPLE, np.zeros(2), 0.0
        self._ahead: Array | None = None
        self._since, self._time = 0, math.nan
        nothing = np.stack([0.0 * self.model.scale, 1.0 / self.model.scale])
        self._last = self._estimate(0.0, nothing, 'not_excited')

    def update(self, time: float, output: Array, command: Array) -> Estimate:
        """
        Return the estimate after the sample of a time.

        A sample with a number that is not finite is rejected: the predictor goes on without it.

        Parameters
        ----------
        time : float
            s.
        output : Array
            (theta_1, theta_2, strain…), rad and m/m, (m,).
        command : Array
            Applied up to this sample, (2,).

        Raises
        ------
        InputError
            Wrong number of outputs.

        """
        output = np.asarray(output)
        if output.shape != self.model.scale.shape:
            raise InputError(f'output: expected {len(self.model.scale)} numbers, '
                             f'got shape {output.shape}')
        # A contiguous array of floats: for another layout Numba would compile anew while the
        # sample waits.
        scaled, command = self.model.scale * output, np.array(command, dtype=float)
        sent = is_finite(command)
        good = sent and is_finite(scaled)
        if sent:
            self._command = command
        self._cross(time)
        if not good:
            return self._reject(time)
        return self._begin(time, scaled) if self.track is None else self._learn(time, scaled)

    def _cross(self, time: float) -> None:
        """Predict the samples that are missing before a time, s; after a long gap begin anew."""
        gap, self._time = time - self._time, time
        steps = round(gap / self.step) if math.isfinite(gap) else 1
        if steps > 1 and gap > LONGEST_GAP_S:
            self.track = None
        for _ in range(steps - 1 if self.track is not None else 0):
            self._predict_alone()

    def _predict_alone(self) -> None:
        """Predict without a sample; where that diverges, start again at the next."""
        if self.track is not None:
            track = self._next_track()
            found = (self._take_ahead() or self._predicted()) and is_finite(track.state)
            self.track = track if found else None
        self._measured = NO_SAMPLE
        self._since += 1

    def _learn(self, time: float, scaled: Array) -> Estimate:
        """Predict, and regress where that is due; start again where the model has diverged."""
        due = self._since + 1 >= self.pace.samples
        reading = np.empty((2, len(scaled)))
        track, ahead = self._next_track(), self._take_ahead()
        sample = scaled, due, tuple(self.known), self._constants, reading
        try:
            surprise, found = take_sample(tuple(track), *sample) if ahead \
                else predict_and_take_sample(self._prediction_arguments(track), *sample)
        except FloatingPointError:
            # With too few terms n' (19) may diverge: the state then starts again at the sample.
            surprise, found = math.nan, self.known
        known = SF1State(*found)
        if not (math.isfinite(surprise + known.mass + known.p)
                and 0.0 < known.variance < math.inf):
            return self._begin(time, scaled, 'model_suspect')
        self.track, self.known, self._angle = track, known, float(scaled[1])
        self._measured, self._since = (scaled, 0) if due else (NO_SAMPLE, self._since + 1)
        return self._estimate_with_status(time, reading)

    def _begin(self, time: float, scaled: Array, status: str = 'not_excited') -> Estimate:
        """Start the state at a sample; the payload keeps its value."""
        start = INITIAL_VARIANCE * np.eye(self.model.states)
        # Two tracks: one is read while the other is written.
        self._tracks = tuple(at_start(scaled, self._sensors, start, self._variance())
                             for _ in range(2))
        self.track = self._tracks[0]
        self.known = self.known._replace(lag=0.0, spread=1.0)
        self._angle, self._measured, self._since = float(scaled[1]), scaled, 0
        reading = np.empty((2, len(scaled)))
        take_sample(tuple(self.track), scaled, False, tuple(self.known), self._constants, reading)
        self._last = self._estimate(time, reading, status)
        return self._last

    def conclude(self) -> None:
        """Do nothing: `update` leaves nothing over."""

    @property
    def events(self) -> Sequence[Event]:
        """Return no changes: SF1 does not look for them."""
        return ()

    @property
    def takes_parts_as_told(self) -> bool:
        """Return True: SF1 knows no tolerances."""
        return True

    @property
    def payload_max(self) -> float:
        """Return the largest payload that is looked for, kg."""
        return largest_payload(self.robot, self.settings.payload_max)

    def prepare(self, command: Array) -> None:
        """
        Predict while no measurement waits: `update` is then faster, with the same answer.

        Parameters
        ----------
        command : Array
            Command that will be applied up to the next sample, (2,). Where `update` gets another
            one, it predicts again.

        """
        command = np.array(command, dtype=float)
        if self.track is not None and self._ahead is None and is_finite(command):
            self._command = command
            self._ahead = command if self._predicted() else None

    def _take_ahead(self) -> bool:
        """Return whether `prepare` has predicted with the command that was in fact applied."""
        ahead, self._ahead = self._ahead, None
        return ahead is not None and ahead.tolist() == self._command.tolist()

    def _next_track(self) -> Track:
        """Return the track that the next prediction may overwrite."""
        assert self.track is not None
        return self._tracks[self.track.joint is self._tracks[0].joint]

    def _predicted(self) -> bool:
        """Write the track at the next sample; return whether the prediction converged."""
        try:
            moved(*self._prediction_arguments(self._next_track()))
            return True
        except FloatingPointError:
            return False

    def _prediction_arguments(self, after: Track) -> tuple[Any, ...]:
        """Return the arguments of joint.moved, which writes the track `after`."""
        assert self.track is not None
        # The covariance is propagated with the secant to a payload one mean deviation heavier: the
        # tangent would overstate the effect of the payload's error, for a heavier one shows less.
        mass = self.known.mass
        heavier = mass + MEAN_DEVIATION * math.sqrt(self._variance())
        noisy = (self._since + 1) % self.pace.samples == 0
        return (tuple(self.track), tuple(after), self._since, math.cos(self._angle),
                self.model.tables, mass, heavier, not self._resolvent,
                self._command, self._measured, self._columns,
                self._process if noisy else self._no_process, self._measurement, self._sensors,
                self._room, self.step)

    def _estimate_with_status(self, time: float, reading: Array) -> Estimate:
        """Return the estimate after a sample, with the status that excitation and noise imply."""
        status = 'ok'
        if max(self.known.level, self.known.misfit) > SUSPECT:
            status = 'model_suspect'
        elif (self.known.excitation <= SIGNIFICANT
              or self.known.variance > 0.5 * self.settings.sf1.variance_0):
            # Noise alone explains the regressor, or the payload is hardly better known than at
            # the start.
            status = 'not_excited'
        self._last = self._estimate(time, reading, status)
        return self._last

    def _reject(self, time: float) -> Estimate:
        """Pass over a sample that says nothing."""
        self._predict_alone()
        self._last = self._last._replace(time=time, status='input_rejected')
        return self._last

    def _estimate(self, time: float, reading: Array, status: str) -> Estimate:
        """Return the estimate; `reading` holds the innovation and its standard deviation."""
        known, variance = self.known, self._variance()
        if not self._resolvent:
            variance *= max(known.misfit, 1.0)
        return Estimate(time, known.mass, variance, known.p, reading[0], reading[1], status)

    def _variance(self) -> float:
        """
        Return the payload's variance, kg^2.

        It is at most the second moment of the prior about the estimate, which holds without any
        sample.
        """
        known, given = self.known, self.settings.sf1
        if not self._resolvent:
            return known.variance
        return min(known.variance, (known.mass - given.mass_0)**2 + given.variance_0)
