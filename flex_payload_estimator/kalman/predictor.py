"""Kalman predictor (23) in delta form: one gain update a sample."""

from __future__ import annotations

from flex_payload_estimator.kalman.riccati import lyapunov_step, riccati_step
from flex_plant_sim.arm.second_order import Array
import numpy as np

INITIAL_VARIANCE = 1e-2


class KalmanPredictor:
    """
    The gain K-bar and the covariance of the prediction error, both in delta form.

    Parameters
    ----------
    output : Array
        C-bar, (m, n).
    r_1, r_2 : Array
        Covariances of one sample's process and measurement noise, (n, n) and (m, m).
    step : float
        T, s.
    initial : float
        P_0 = initial I.

    """

    def __init__(self, output: Array, r_1: Array, r_2: Array, step: float,
                 initial: float = INITIAL_VARIANCE):
        self.output, self.step, self._initial = output, step, initial
        self.r_1, self.r_2 = r_1, r_2
        self._columns = np.ascontiguousarray(output.T)
        self._process, self._measurement = r_1 / step, r_2 * step
        self.reset()

    def reset(self) -> None:
        """Go back to P_0."""
        self.covariance = self._initial * np.eye(self.output.shape[1])

    def innovation_covariance(self) -> Array:
        """Return C P C' + R_2 of the output to come, (m, m)."""
        covariance: Array = self.output.dot(self.covariance).dot(self._columns) + self.r_2
        return covariance

    def update(self, a_bar: Array) -> Array:
        """
        Return K-bar (n, m) of (23) and move P one sample on.

        Parameters
        ----------
        a_bar : Array
            A-bar, (n, n).

        """
        gain, self.covariance, _ = riccati_step(
            a_bar.T, self._columns, self._process, self._measurement, self.covariance, self.step)
        return gain.T

    def skip(self, a_bar: Array) -> None:
        """Move P one sample on without a measurement."""
        self.covariance = lyapunov_step(a_bar.T, self._process, self.covariance, self.step)
