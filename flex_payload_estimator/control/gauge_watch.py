"""Tells a gauge that does not move as the arm bends, by a predictor of its own."""

from __future__ import annotations

import math

from flex_payload_estimator.kalman.predictor import KalmanPredictor
from flex_payload_estimator.kalman.riccati import DOUBLINGS
from flex_payload_estimator.model.payload_model import PayloadModel
from flex_plant_sim.arm.second_order import Array
import numpy as np

# What may act on the arm unknown to its model, as white noise. Torque of a joint: this share of
# its largest command.
TORQUE = 0.1
# Force at the tip, over what the largest payload takes of that torque's acceleration: the payload
# is not known, and is picked and dropped.
FORCE = 3.0
# Error of a gauge, over the strain that this noise makes.
GAUGE = 0.01
# Change of cos(theta_2) after which the directions of torques and force are computed anew.
TURNED = 0.05
# Time that is averaged over, s, and that is not judged after the start.
SPAN = 2.0
# Error of a gauge's prediction, over the bending of its link, from which the gauge is wrong. All
# but TURNED are calibrated by benchmarks/sensor_faults.py.
WRONG = 0.4
# Change of a vibration's phase within a sample by a payload that is not known, rad, up to which
# gauges are predicted: from 0.23 on arms whose sensors are right come near WRONG, from 0.3 on
# beyond.
PHASE = 0.22


def longest_interval(model: PayloadModel, mass_max: float) -> float:
    """
    Return the longest time between samples, s, at which gauges can be watched.

    A payload from none to the largest, kg, shifts the slowest vibration of each link; a prediction
    without the payload is off by that phase a sample.
    """
    empty, loaded = (
        sorted(abs(root) for root in np.linalg.eigvals(model.matrices(1.0, mass)[0])
               if root.imag > 0.0)[:2] for mass in (0.0, mass_max))
    shift = max((abs(one - other) for one, other in zip(empty, loaded)), default=0.0)
    return PHASE / shift if shift else math.inf


class GaugeWatch:
    """
    Compares each gauge with what the other sensors and the commands say, one sample ahead.

    The predictor allows for any torque of the joints and any force at the tip. Friction, pushes,
    walls and another payload are such, and soft links almost; a gauge that is dead, inverted, or
    exchanged with another is not, nor is an angle that does not belong to the bending. A gauge's
    error is the root mean square of its innovations over that of its link's gauges, where these
    bend more than the noise of the torques makes them bend.

    Parameters
    ----------
    model : PayloadModel
    a_bar, b_bar : Array
        The sampled model about the start, (n, n) and (n, 2).
    largest : Array
        Largest commands, (2,).
    mass_max : float
        Largest payload, kg.
    link : Array
        Link of each gauge, 0 or 1, (g,).
    noise : Array
        Standard deviation of the outputs' noise, rad and m/m, (2 + g,).
    step : float
        T, s.

    Attributes
    ----------
    error : Array
        Of each gauge, (g,); 0 before SPAN.

    """

    def __init__(self, model: PayloadModel, a_bar: Array, b_bar: Array, largest: Array,
                 mass_max: float, link: Array, noise: Array, step: float):
        self._model, self._step, self._mass_max = model, step, mass_max
        self._torque, self._same = TORQUE * np.asarray(largest), link[:, None] == link
        n, gauges = model.states, model.output[2:]
        strain = np.sqrt(np.einsum('ij,jk,ik->i', gauges, self._steady(a_bar, b_bar), gauges))
        self._floor = self._same @ strain**2
        deviation = model.scale * noise
        deviation[2:] = np.hypot(deviation[2:], GAUGE * strain)
        self._kalman = KalmanPredictor(model.output, np.zeros((n, n)), np.diag(deviation**2), step)
        self._keep = math.exp(-step / SPAN)
        self.reset()

    def _steady(self, a_bar: Array, b_bar: Array) -> Array:
        """Return the covariance of the state after SPAN of that noise, (n, n)."""
        process, ahead = self._process(b_bar, 1.0), np.eye(len(a_bar)) + self._step * a_bar
        covariance = process
        for _ in range(min(DOUBLINGS, math.ceil(math.log2(SPAN / self._step)))):
            covariance = covariance + ahead @ covariance @ ahead.T
            ahead = ahead @ ahead
        return covariance

    def _process(self, b_bar: Array, cosine: float) -> Array:
        """Return the covariance of one sample's noise, (n, n)."""
        # A payload changes all accelerations along the answer to a force at the tip.
        force = FORCE * (self._model.matrices(cosine, 0.0)[1]
                         - self._model.matrices(cosine, self._mass_max)[1])
        entry = self._step * np.hstack([b_bar, force]) * np.tile(self._torque, 2)
        return np.asarray(entry @ entry.T)

    def reset(self) -> None:
        """Forget everything."""
        self._kalman.reset()
        self._state = np.zeros(self._model.states)
        self._cosine = math.inf
        self._before: tuple[Array | None, Array, Array] | None = None
        self._square, self._bending = np.zeros_like(self._floor), np.zeros_like(self._floor)
        self.error, self._count = np.zeros_like(self._floor), 0

    def __call__(self, output: Array | None, command: Array, a_bar: Array, b_bar: Array,
                 cosine: float) -> int | None:
        """
        Return the index of the gauge that is wrong most, or None.

        Parameters
        ----------
        output : Array or None
            Scaled as the model's, (2 + g,); None where the sample says nothing.
        command : Array
            Applied up to this sample, (2,).
        a_bar, b_bar : Array
            The sampled model from this sample on, (n, n) and (n, 2).
        cosine : float
            Of theta_2.

        """
        if self._before is not None:
            heard, a_last, b_last = self._before
            self._state = self._kalman.advance(self._state, a_last, b_last, command, heard)
        elif output is not None:
            self._state[:2] = output[:2]
        if abs(cosine - self._cosine) > TURNED:
            self._cosine = cosine
            self._kalman.disturb(self._process(b_bar, cosine))
        self._before = output, a_bar, b_bar
        if output is None:
            return None
        innovation = output[2:] - self._model.output[2:] @ self._state
        self._square += (1.0 - self._keep) * (innovation**2 - self._square)
        self._bending += (1.0 - self._keep) * (self._same @ output[2:]**2 - self._bending)
        self._count += 1
        if self._count * self._step < SPAN:
            return None
        self.error = np.sqrt(self._square / (self._bending + self._floor))
        worst = int(np.argmax(self.error)) if self.error.size else 0
        return worst if self.error.size and self.error[worst] > WRONG else None
