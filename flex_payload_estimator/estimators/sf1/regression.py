"""The regression (24)-(28): a composite measurement that is linear in the payload."""

from __future__ import annotations

from dataclasses import dataclass

from flex_payload_estimator.estimators.sf1.adaptation import sf1_step
from flex_payload_estimator.model.payload_model import PayloadModel
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
import numpy as np

# The variance of e is at least this share of what the sensors alone give.
FLOOR = 1e-6


@dataclass(frozen=True)
class CompositeMeasurement:
    """
    y' = weights y, a weighted sum of all measurements, and C-bar' = weights C-bar, (26).

    Attributes
    ----------
    weights : Array
        (m,), over the outputs in rad and V.
    row : Array
        C-bar', (n,).

    """

    weights: Array
    row: Array

    @classmethod
    def end_point(cls, model: PayloadModel) -> CompositeMeasurement:
        """
        Return theta_2e, the angle of the forearm's end-point, as the gauges show it.

        With as many gauges as modes the row is theta_2e itself. Otherwise the modes are weighted
        by what a static load would excite, omega_i^-2, and C-bar' is what the gauges then say,
        so that (26) holds for the model in any case.
        """
        output = model.output
        weighted = output * model.spread**2
        gram = weighted @ output.T
        weights = np.linalg.lstsq(gram, weighted @ model.end_point, rcond=1e-12)[0]
        return cls(np.asarray(weights, dtype=np.float64), weights @ output)


@compiled
def regression(row: Array, composite: float, predicted_0: Array,
               predicted_m: Array) -> tuple[float, float]:
    """
    Return psi_t = y'_t - C-bar' x^0_t and phi_t = C-bar' x^m_t, (28).

    Parameters
    ----------
    row : Array
        C-bar', (n,).
    composite : float
        y'_t, rad.
    predicted_0, predicted_m : Array
        x^0_t and x^m_t of (25), (n,).

    """
    return composite - np.dot(row, predicted_0), np.dot(row, predicted_m)


@compiled
def compared(prediction: Array, scaled: Array, mass: float, weights: Array, row: Array,
             columns: Array, covariance: Array, noise: Array, scale: Array
             ) -> tuple[float, float, float, float, float, Array]:
    """
    Return what a sample says beside its prediction.

    Parameters
    ----------
    prediction : Array
        State x^0 + m x^m, part x^m and slope x' per kg of (25), (3, n); x' is what x^m is with
        the tangent split.
    scaled : Array
        The sample, rad and V, (m,).
    mass : float
        m_{t-1}, kg.
    weights, row : Array
        See CompositeMeasurement.
    columns, covariance, noise : Array
        C-bar' (n, m), P (n, n) of the predictor and the diagonal of R_2, (m,).
    scale : Array
        From (rad, rad, m/m…) to (rad, rad, V…), (m,).

    Returns
    -------
    tuple
        psi_t and phi_t of (28); C-bar' x' (rad/kg); C-bar' P C-bar''; the mean of (innovation /
        standard deviation)^2; innovation and standard deviation, rad and m/m, (2, m).

    """
    state, part = prediction[0], prediction[1]
    psi, phi = regression(row, np.dot(weights, scaled), state - mass * part, part)
    innovation = scaled - np.dot(state, columns)
    variances = np.sum(columns * np.dot(covariance, columns), axis=0) + noise
    surprise = np.dot(innovation, innovation / variances) / len(scale)
    reading = np.empty((2, len(scale)))
    reading[0], reading[1] = innovation / scale, np.sqrt(variances) / scale
    return (psi, phi, np.dot(row, prediction[2]), np.dot(row, np.dot(covariance, row)), surprise,
            reading)


@compiled
def regressed(prediction: Array, scaled: Array, mass: float, p: float, variance: float,
              noise: float, samples: float, weights: Array, row: Array, columns: Array,
              covariance: Array, sample_noise: Array, scale: Array, composite_noise: float,
              reference: float, constants: tuple[float, float, float, float], resolvent: bool
              ) -> tuple[Array, float, float, float, float, float, float, Array]:
    """
    Return what (28), (29) make of a prediction and a sample.

    Parameters
    ----------
    prediction, scaled, weights, row, columns, covariance, sample_noise, scale
        See `compared`.
    mass, p, variance : float
        See SF1State.
    noise, samples : float
        Variance of e, rad^2, and over how many samples it is averaged: R_1 and R_2 are tuning,
        not noise.
    composite_noise, reference : float
        Variance of the composite measurement and of its settled innovation, rad^2.
    constants : tuple
        alpha_0, alpha_1, the payload's walk in a sample, kg^2, and its largest value, kg.
    resolvent : bool
        Normalise, and carry the state on by (24).

    Returns
    -------
    tuple
        State (n,); mass, P, variance; the variance of e; what the sample told, per kg^2; surprise
        and reading of `compared`.

    """
    psi, phi, seen, spread, surprise, reading = compared(
        prediction, scaled, mass, weights, row, columns, covariance, sample_noise, scale)
    error = psi - phi * mass
    noise = max(FLOOR * composite_noise, noise + (error * error - noise) / samples)
    weight = reference / (spread + composite_noise) if resolvent else 1.0
    alpha_0, alpha_1, walk, largest = constants
    after, p, variance = sf1_step(mass, p, variance, psi, phi, seen, noise, weight, alpha_0,
                                  alpha_1, walk)
    state = prediction[0].copy()
    if resolvent:
        state += (min(max(after, 0.0), largest) - mass) * prediction[1]
    return state, after, p, variance, noise, seen * seen / noise, surprise, reading
