"""Tells a gauge that does not move as the arm bends, by a predictor of its own."""

from __future__ import annotations

import math

from flex_payload_estimator.kalman.predictor import KalmanPredictor
from flex_payload_estimator.kalman.riccati import settled
from flex_payload_estimator.model.payload_model import PayloadModel
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.arm.state_space import zero_order_hold
from flex_plant_sim.riccati import DOUBLINGS
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
# Factor of the error of a right arm over what its model says of a payload that is not known, see
# `unknown_payload_error`; calibrated there, too.
MARGIN = 1.3
# Error of a dead gauge that is alone on its link: the whole bending is missing.
DEAD = 1.0
# Time for which a command stays as it is, s; from 0.1 to 0.5 the errors are alike to a tenth.
COMMAND_TIME = 0.5


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
    payload_max : float
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
    payload_error : float
        Error on a right arm whose payload is not known.
    bound : float
        Error from which a gauge is wrong. Where it is DEAD or more, gauges tell nothing.

    """

    def __init__(self, model: PayloadModel, a_bar: Array, b_bar: Array, largest: Array,
                 payload_max: float, link: Array, noise: Array, step: float):
        self._model, self._step, self._payload_max = model, step, payload_max
        self._torque, self._same = TORQUE * np.asarray(largest), link[:, None] == link
        n, gauges = model.states, model.output[2:]
        bent = self._after_span(np.eye(n) + step * a_bar, self._process(b_bar, 1.0))
        strain = np.sqrt(np.einsum('ij,jk,ik->i', gauges, bent, gauges))
        self._floor = self._same @ strain**2
        deviation = model.scale * noise
        deviation[2:] = np.hypot(deviation[2:], GAUGE * strain)
        self._kalman = KalmanPredictor(model.output, np.zeros((n, n)), np.diag(deviation**2), step)
        self._keep = math.exp(-step / SPAN)
        self.reset()
        self.payload_error = max(self.unknown_payload_error(0.0, payload_max),
                                 self.unknown_payload_error(payload_max, 0.0))
        self.bound = max(WRONG, MARGIN * self.payload_error)

    def unknown_payload_error(self, believed: float, carried: float) -> float:
        """
        Return the largest error of a gauge on a right arm that carries another payload, kg.

        From the covariance of arm, predictor and commands of half the largest after SPAN. With the
        payload the vibrations change, and a predictor for another is off by their phase a sample.
        """
        model, step = self._model, self._step
        arm, command = zero_order_hold(*model.matrices(1.0, carried), step)
        own, own_command = zero_order_hold(*model.matrices(1.0, believed), step)
        n, unit = len(arm), np.eye(len(arm))
        gain = settled((own - unit).T / step, model.output.T,
                       self._process(own_command / step, 1.0) / step, step * self._kalman.r_2,
                       step)[0].T
        heard = step * gain @ model.output
        kept = math.exp(-step / COMMAND_TIME)
        ahead = np.block([
            [arm, np.zeros((n, n)), command],
            [heard, own - heard, own_command],
            [np.zeros((2, 2 * n)), kept * np.eye(2)]])
        fresh = np.zeros(2 * n + 2)
        fresh[2 * n:] = (1.0 - kept**2) * (0.5 / TORQUE * self._torque)**2
        covariance = self._after_span(ahead, np.diag(fresh))
        gauges = model.output[2:]
        bending = np.einsum('ij,jk,ik->i', gauges, covariance[:n, :n], gauges)
        missed = np.hstack([gauges, -gauges])
        square = np.einsum('ij,jk,ik->i', missed, covariance[:2 * n, :2 * n], missed)
        return float(np.sqrt(np.max(square / (self._same @ bending + self._floor), initial=0.0)))

    def _after_span(self, ahead: Array, process: Array) -> Array:
        """Return the covariance of a state that began at zero, after SPAN of noise, (n, n)."""
        covariance = process
        for _ in range(min(DOUBLINGS, math.ceil(math.log2(SPAN / self._step)))):
            covariance = covariance + ahead @ covariance @ ahead.T
            ahead = ahead @ ahead
        return covariance

    def _process(self, b_bar: Array, cosine: float) -> Array:
        """Return the covariance of one sample's noise, (n, n)."""
        # A payload changes all accelerations along the answer to a force at the tip.
        force = FORCE * (self._model.matrices(cosine, 0.0)[1]
                         - self._model.matrices(cosine, self._payload_max)[1])
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
        return worst if self.error.size and self.error[worst] > self.bound else None
