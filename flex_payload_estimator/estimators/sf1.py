"""The paper's payload estimator: predictor (23), regression (25)-(28), selective forgetting (29)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

from flex_payload_estimator.delta import omega
from flex_payload_estimator.estimators.base import Estimate
from flex_payload_estimator.kalman import KalmanPredictor
from flex_payload_estimator.payload_model import payload_model
from flex_payload_estimator.regression import CompositeMeasurement, regression
from flex_payload_estimator.sf1 import bounded, SF1Settings, SF1State, sf1_update
from flex_plant_sim.arm_model import Array
from flex_plant_sim.errors import InputError
from flex_plant_sim.robot import Robot
import numpy as np

Regression = Literal['paper', 'resolvent']
MEMORY = 0.5
EXCITED = 9.0
SUSPECT = 9.0


@dataclass(frozen=True)
class SF1EstimatorSettings:
    """
    What (30) gives, and the choices beside it.

    Attributes
    ----------
    regression : str
        'paper': split (15), (16), psi and phi as printed. 'resolvent': resolvent split, psi and
        phi divided by the standard deviation of the composite innovation.
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


PAPER_SETTINGS = SF1EstimatorSettings(regression='paper', exact=False)


class SF1Estimator:
    """
    SF1 on a delta model (section 4.1).

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
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.kalman.reset()
        self.state = np.zeros(self.model.states)
        self.sf1 = SF1State.start(self.settings.sf1)
        self._output: Array | None = None
        self._angle, self._started = 0.0, False
        self._command = np.zeros(2)
        self._information, self._surprise = 0.0, 1.0
        self._last = self._estimate(0.0, np.zeros(len(self.model.output)), 'not_excited')

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
        scaled = self.model.scale * output
        good = bool(np.isfinite(scaled).all() and np.isfinite(command).all())
        if np.isfinite(command).all():
            self._command = np.asarray(command, dtype=float)
        if not self._started:
            return self._begin(time, scaled) if good else self._reject(time, scaled)
        before, slope = self._predict()
        if not good:
            self.state, self._output = before + self.sf1.mass * slope, None
            return self._reject(time, scaled)
        return self._correct(time, scaled, before, slope)

    def _begin(self, time: float, scaled: Array) -> Estimate:
        self.state[:2] = scaled[:2]
        self._started = True
        return self._finish(time, scaled, scaled - self.model.output.dot(self.state))

    def _predict(self) -> tuple[Array, Array]:
        """Return x^0_t and x^m_t, (25)."""
        x, u, step = self.state, self._command, self.step
        split = self.model.split(np.cos(self._angle), self.sf1.mass, self._split_kind)
        big = step * omega(split.a, step, self.settings.terms, self.halvings)
        slope = big.dot(split.a_m.dot(x) + split.b_m.dot(u))
        a_bar = big.dot(split.a) / step
        whole = x + big.dot(split.a.dot(x) + split.b.dot(u))
        if self._output is None:
            self.kalman.skip(a_bar)
        else:
            gain = self.kalman.update(a_bar)
            whole = whole + step * gain.dot(self._output - self.model.output.dot(x))
        return whole - self.sf1.mass * slope, slope

    @property
    def _split_kind(self) -> Regression:
        return self.settings.regression

    def _correct(self, time: float, scaled: Array, before: Array, slope: Array) -> Estimate:
        innovation = scaled - self.model.output.dot(before + self.sf1.mass * slope)
        row = self.composite.row
        psi, phi = regression(row, float(self.composite.weights.dot(scaled)), before, slope)
        noise = float(row.dot(self.kalman.covariance.dot(row))) + self._composite_noise
        updated = sf1_update(self.sf1, psi, phi, noise, self.settings.sf1, self.step,
                             self.settings.regression == 'resolvent')
        self.sf1 = bounded(updated, 0.0, self.settings.mass_max)
        self._information += phi * phi / noise - self.step / MEMORY * self._information
        self.state = before + self.sf1.mass * slope
        return self._finish(time, scaled, innovation)

    def _finish(self, time: float, scaled: Array, innovation: Array) -> Estimate:
        self._output, self._angle = scaled, float(scaled[1])
        variances = self.kalman.innovation_covariance().diagonal()
        surprise = float(np.mean(innovation * innovation / variances))
        self._surprise += self.step / MEMORY * (surprise - self._surprise)
        status = 'ok'
        if self._surprise > SUSPECT:
            status = 'model_suspect'
        elif self._information * self.settings.sf1.variance_0 < EXCITED:
            status = 'not_excited'
        self._last = self._estimate(time, innovation, status)
        return self._last

    def _reject(self, time: float, scaled: Array) -> Estimate:
        self._last = replace(self._last, time=time, status='input_rejected')
        return self._last

    def _estimate(self, time: float, innovation: Array, status: str) -> Estimate:
        deviation = np.sqrt(self.kalman.innovation_covariance().diagonal())
        scale = self.model.scale
        return Estimate(time, self.sf1.mass, self.sf1.variance, self.sf1.p,
                        innovation / scale, deviation / scale, status)
