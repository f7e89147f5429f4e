"""The paper's payload estimator: predictor (23), regression (25)-(28), SF1 (29)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
import math
from typing import Any, Literal

from flex_payload_estimator.estimators.base import Estimate
from flex_payload_estimator.estimators.sf1.adaptation import bounded, SF1Settings, SF1State
from flex_payload_estimator.estimators.sf1.regression import (
    compared,
    CompositeMeasurement,
    regressed,
)
from flex_payload_estimator.kalman.predictor import KalmanPredictor
from flex_payload_estimator.model.delta import DeltaOperator
from flex_payload_estimator.model.payload_model import payload_model
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from msg_config.errors import InputError
import numpy as np

Regression = Literal['paper', 'resolvent']
# s; how far back noise, excitation and surprise are averaged.
MEMORY = 1.0
# What the last second alone must tell: ten times less variance than was assumed at the start.
EXCITED = 9.0
SUSPECT = 9.0
SETTLING = 200
PRIOR_SAMPLES = 2.0


@dataclass(frozen=True)
class SF1EstimatorSettings:
    """
    What (30) gives, and the choices beside it.

    Attributes
    ----------
    regression : str
        'paper': split (15), (16), psi and phi as printed, the state carried on by (23).
        'resolvent': resolvent split, psi and phi divided by the standard deviation of the
        composite innovation over its settled value (so that the constants keep their scale),
        the state carried on by (24).
    r_1, r_2 : float
        R_1 = r_1 I, R_2 = r_2 I of the predictor, angles in rad, gauges in V.
    terms : int
        n' of (19).
    exact : bool
        Halve the step where n' terms do not reach full accuracy.
    mass_max : float
        The estimate stays in [0, mass_max], kg.
    sf1 : SF1Settings

    """

    regression: Regression = 'resolvent'
    r_1: float = 1e-4
    r_2: float = 1e-4
    terms: int = 15
    exact: bool = True
    mass_max: float = 2.0
    sf1: SF1Settings = field(default_factory=SF1Settings)

    def __post_init__(self) -> None:
        """Validate."""
        if self.regression not in ('paper', 'resolvent'):
            raise InputError('regression: expected paper or resolvent, got '
                             f'{self.regression!r}')


def is_finite(values: Array) -> bool:
    """Tell whether all are finite; for a few, a list is quicker than an array."""
    return all(map(math.isfinite, values.tolist()))


PAPER_SETTINGS = SF1EstimatorSettings(regression='paper', exact=False)


class SF1Estimator:
    """
    SF1 on a delta model (section 4.1).

    It regresses on one composite measurement and one step, so that it needs as many gauges on a
    link as modes: with more modes the gauges cannot tell theta_2e, and it may settle elsewhere.

    Parameters
    ----------
    robot : Robot
        Its payload mass is not used.
    model : str
        'paper_reduced', 'paper' or 'assumed_modes'; regression 'paper' needs the first.
    modes : int
        Modes a link.
    settings : SF1EstimatorSettings

    """

    def __init__(self, robot: Robot, model: str = 'paper_reduced', modes: int = 2,
                 settings: SF1EstimatorSettings = SF1EstimatorSettings()):
        if settings.regression == 'paper' and model != 'paper_reduced':
            raise InputError(f'regression: paper needs model paper_reduced, got {model!r}')
        self.robot, self.settings, self.step = robot, settings, robot.sample_time
        self.model = payload_model(robot, model, modes)
        self.halvings = self.model.halvings if settings.exact else 0
        self.composite = CompositeMeasurement.end_point(self.model)
        n, m = self.model.states, len(self.model.output)
        self._composite_noise = settings.r_2 * float(self.composite.weights
                                                     @ self.composite.weights)
        self.kalman = KalmanPredictor(self.model.output, settings.r_1 * np.eye(n),
                                      settings.r_2 * np.eye(m), self.step)
        self._omega = DeltaOperator(n, self.step, settings.terms, self.halvings)
        self._columns = np.ascontiguousarray(self.model.output.T)
        self._sample_noise = np.full(m, settings.r_2)
        self._constants = (settings.sf1.alpha_0, settings.sf1.alpha_1,
                           settings.sf1.drift * self.step, settings.mass_max)
        self._reference = self._settled_noise()
        self.reset()
        for _ in range(2):
            # Compile what is compiled, so that no sample waits for it.
            self.update(0.0, np.zeros(m), np.zeros(2))
        self.reset()

    def _settled_noise(self) -> float:
        """Return the variance to which the composite innovation settles, straight, unloaded."""
        a, _ = self.model.matrices(1.0, 0.0)
        a_bar = self._omega(a).dot(a)
        for _ in range(SETTLING):
            self.kalman.update(a_bar)
        return self._innovation_variance()

    def _innovation_variance(self) -> float:
        """Return the variance of y' - C-bar' x that the predictor expects, rad^2."""
        row = self.composite.row
        return float(row.dot(self.kalman.covariance.dot(row))) + self._composite_noise

    def reset(self) -> None:
        """Forget everything."""
        self.kalman.reset()
        self.state = np.zeros(self.model.states)
        self.sf1 = SF1State.start(self.settings.sf1)
        self._output = np.zeros(0)
        self._angle, self._started = 0.0, False
        self._command = np.zeros(2)
        self._ahead: tuple[Array, Array, Array] | None = None
        self._information, self._surprise, self._samples = 0.0, 1.0, PRIOR_SAMPLES
        self._noise = self._reference
        scale = self.model.scale
        self._last = self._estimate(0.0, np.stack([0.0 * scale, 1.0 / scale]), 'not_excited')

    def update(self, time: float, output: Array, command: Array) -> Estimate:
        """
        Return the estimate after the sample of a time.

        A sample with a number that is not finite is rejected: the predictor runs on without it.

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
        if np.shape(output) != self.model.scale.shape:
            raise InputError(f'output: expected {len(self.model.scale)} numbers, '
                             f'got shape {np.shape(output)}')
        # Another layout in memory would be compiled for while the sample waits.
        scaled, command = self.model.scale * output, np.array(command, dtype=float)
        sent = is_finite(command)
        good = sent and is_finite(scaled)
        if sent:
            self._command = command
        if not self._started:
            return self._begin(time, scaled) if good else self._reject(time)
        prediction = self._predict()
        if not good:
            self.state, self._output = prediction[0], np.zeros(0)
            return self._reject(time)
        return self.regress(time, scaled, prediction)

    def _begin(self, time: float, scaled: Array) -> Estimate:
        self.state[:2] = scaled[:2]
        self._started = True
        prediction = np.stack([self.state, 0.0 * self.state, 0.0 * self.state])
        return self._finish(time, scaled, *self._compared(prediction, scaled)[4:])

    def _compared(self, prediction: Array, scaled: Array) -> tuple[Any, ...]:
        return compared(prediction, scaled, self.sf1.mass, self.composite.weights,
                        self.composite.row, self._columns, self.kalman.covariance,
                        self._sample_noise, self.model.scale)

    def prepare(self, command: Array) -> None:
        """
        Predict while no measurement waits: `update` is then quicker, and its answer the same.

        Parameters
        ----------
        command : Array
            What will have been applied up to the next sample, (2,); where `update` is told
            otherwise, it predicts again.

        """
        command = np.array(command, dtype=float)
        if self._started and self._ahead is None and is_finite(command):
            self._command = command
            before = self.kalman.covariance
            self._ahead = self._command, self._predict(), before

    def _predict(self) -> Array:
        """Return (25) as rows, see `compared`, with P moved on."""
        if self._ahead is not None:
            command, prediction, before = self._ahead
            self._ahead = None
            if command.tolist() == self._command.tolist():
                return prediction
            self.kalman.covariance = before
        a, rates = self.model.rates(math.cos(self._angle), self.sf1.mass, self.state,
                                    self._command, self.settings.regression)
        return self.kalman.predict(self.state, a, rates, self._omega.room, self._output)

    def regress(self, time: float, scaled: Array, prediction: Array) -> Estimate:
        """Regress (28), (29) on a prediction and carry the state on."""
        self._samples = min(self._samples + 1.0, MEMORY / self.step)
        self.state, mass, p, variance, self._noise, told, surprise, reading = regressed(
            prediction, scaled, *self.sf1, self._noise, self._samples, self.composite.weights,
            self.composite.row, self._columns, self.kalman.covariance, self._sample_noise,
            self.model.scale, self._composite_noise, self._reference, self._constants,
            self.settings.regression == 'resolvent')
        self.sf1 = bounded(SF1State(mass, p, variance), 0.0, self.settings.mass_max)
        self._information += told - self.step / MEMORY * self._information
        return self._finish(time, scaled, surprise, reading)

    def _finish(self, time: float, scaled: Array, surprise: float, reading: Array) -> Estimate:
        self._output, self._angle = scaled, float(scaled[1])
        self._surprise += min(1.0, self.step / MEMORY) * (surprise - self._surprise)
        status = 'ok'
        if self._surprise > SUSPECT:
            status = 'model_suspect'
        elif self._information * self.settings.sf1.variance_0 < EXCITED:
            status = 'not_excited'
        self._last = self._estimate(time, reading, status)
        return self._last

    def _reject(self, time: float) -> Estimate:
        self._last = replace(self._last, time=time, status='input_rejected')
        return self._last

    def _estimate(self, time: float, reading: Array, status: str) -> Estimate:
        return Estimate(time, self.sf1.mass, self.sf1.variance, self.sf1.p, reading[0],
                        reading[1], status)
