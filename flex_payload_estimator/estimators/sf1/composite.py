"""The composite measurement y' (26), linear in the payload, and its psi and phi (28)."""

from __future__ import annotations

from dataclasses import dataclass

from flex_payload_estimator.model.payload_model import PayloadModel
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
import numpy as np


@dataclass(frozen=True)
class CompositeMeasurement:
    """
    y' = weights y, a weighted sum of all measurements, and C-bar' = weights C-bar, (26).

    Attributes
    ----------
    weights : Array
        Weights of the outputs in rad and V, (m,).
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
        by their response to a static load, omega_i^-2, and C-bar' is what the gauges then
        measure, so that (26) holds for the model in any case.
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
