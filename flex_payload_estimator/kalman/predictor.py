"""Kalman predictor (23) in delta form: one gain update a sample."""

from __future__ import annotations

from flex_payload_estimator.kalman.riccati import lyapunov_step, riccati_step
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
import numpy as np

# Of each state. Chosen: with 1e-4 to 1, SF1's payload is the same to 1e-4 kg from 3 s on.
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

    """

    def __init__(self, output: Array, r_1: Array, r_2: Array, step: float):
        self.output, self.step = output, step
        self.r_2 = r_2
        self._columns = np.ascontiguousarray(output.T)
        self._process, self._measurement = r_1 / step, r_2 * step
        self._nothing, self._noise = np.zeros(len(output)), np.diag(r_2).copy()
        self.reset()

    def reset(self) -> None:
        """Go back to P_0."""
        self.covariance = INITIAL_VARIANCE * np.eye(self.output.shape[1])
        self.gain = np.zeros_like(self._columns)

    def disturb(self, r_1: Array) -> None:
        """Let process noise of covariance R_1, (n, n), act from the next sample on."""
        self._process = r_1 / self.step

    def advance(self, state: Array, a_bar: Array, b_bar: Array, command: Array,
                measured: Array | None) -> Array:
        """
        Return the state one sample on by (23), (n,), and move P on; K-bar (n, m) is in `gain`.

        Parameters
        ----------
        state : Array
            (n,).
        a_bar, b_bar : Array
            A-bar (n, n) and B-bar (n, 2).
        command : Array
            u, (2,).
        measured : Array or None
            Outputs at the state's time, (m,); none where there was no measurement.

        """
        state, self.covariance, self.gain = predicted(
            state, self.covariance, a_bar, b_bar, command, self.output, self._columns,
            self._nothing if measured is None else measured, measured is not None,
            self._process, self._measurement, self.step)
        return state

    def explains(self, state: Array, measured: Array, gate: float, least: float) -> bool:
        """
        Return whether outputs (m,) are within `gate` standard deviations of what is expected.

        A variance below `least` counts as that.
        """
        return explained(state, self.covariance, self.output, measured, self._noise, gate, least)


@compiled
def predicted(state: Array, covariance: Array, a_bar: Array, b_bar: Array, command: Array,
              output: Array, columns: Array, measured: Array, heard: bool, process: Array,
              measurement: Array, step: float) -> tuple[Array, Array, Array]:
    """
    Return x (n,), P (n, n) and K-bar (n, m) one sample of `step` s on, see KalmanPredictor.

    `columns` is C', contiguous, (n, m).
    """
    change = np.dot(a_bar, state) + np.dot(b_bar, command)
    gain = np.zeros_like(output)
    if heard:
        gain, covariance, _ = riccati_step(a_bar.T, columns, process, measurement, covariance,
                                           step)
        change += np.dot(measured - np.dot(output, state), gain)
    else:
        covariance = lyapunov_step(a_bar.T, process, covariance, step)
    return state + step * change, covariance, gain.T


@compiled
def explained(state: Array, covariance: Array, output: Array, measured: Array, noise: Array,
              gate: float, least: float) -> bool:
    """
    Return whether e_i^2 <= gate^2 (C P C' + R_2)_ii for all i.

    `noise` is R_2's diagonal, (m,); `least` the least of these variances.
    """
    innovation, projected = measured - np.dot(output, state), np.dot(output, covariance)
    for i in range(len(innovation)):
        variance = max(np.dot(projected[i], output[i]) + noise[i], least)
        # A comparison with NaN is false.
        if not innovation[i]**2 <= gate**2 * variance:
            return False
    return True
