"""A sample, and what a filter of one hypothesis knows after it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

from flex_payload_estimator.estimators.rpe.linearised import LinearisedModel
from flex_payload_estimator.estimators.rpe.modes import Mode
from flex_payload_estimator.estimators.rpe.packing import unpack
from flex_payload_estimator.estimators.rpe.time_update import MASS
from flex_plant_sim.arm.second_order import Array
import numpy as np


class Sample(NamedTuple):
    """
    A sample of the arm.

    Attributes
    ----------
    time : float
        s.
    measured : Array or None
        Angles and strains, rad and m/m, (m,); None where there is no measurement.
    command : Array
        What acted at the drives since the sample before, (2,).
    command_variance : Array or None
        Variance of that command where it is uncertain, in its unit squared, (2,).
    steps : int
        Sampling times since the sample before.

    """

    time: float
    measured: Array | None
    command: Array
    command_variance: Array | None = None
    steps: int = 1


@dataclass(slots=True)
class Filter:
    """
    The joint posterior of state and parameters under one hypothesis.

    A step writes the arrays in place, so no two filters may share one. n states, B parameters
    and m channels; see time_update.py for the factored covariance.

    Attributes
    ----------
    mode : Mode
    packed : Array
        All arrays that a step writes, one after the other; see packing.unpack.
    sizes : tuple of int
        n, B and m.
    x : Array
        State at the reference parameters, (n,).
    cov : Array
        P, the covariance of the state for known parameters, (n, n).
    sensitivity : Array
        s = dx/dbeta, (n, B).
    beta : Array
        Estimate of the parameters, (B,).
    beta_cov : Array
        V, the covariance of beta, (B, B).
    statistics : Array
        Running statistics of the innovations; see likelihood.initial_statistics, (m + 17,).
    noise_scale : Array
        Estimated variance of each channel's noise over that in the robot file, (m,); the first
        part of `statistics`.
    innovations : Array
        Innovation of the last sample and its expected standard deviation, rad and m/m, (2, m).
    reference : Array
        Parameters about which the model is linearised, (B,): those of `model`, or beta itself.
    model : LinearisedModel or None
        The model about fixed parameters; None where every step is linearised about the estimate.
    log_likelihood, recent_log_likelihood : float
        Since the filter began, and with an exponentially fading memory, nats.
    log_density, stated_log_density : float
        Log-likelihood of the last sample, scaled to the fit so far, and as the filter states it;
        see likelihood.update_statistics.
    mean_square : float
        Mean square of the last sample's whitened innovations.
    passes : int
        Gauss-Newton passes over the sample window so far; see window_pass.py.
    age, age_linearised : float
        Time in motion that the filter has learnt, s, and what it was at the last linearisation.
    misfit : float
        Variance factor that earlier filters had over samples that this one has not learnt; see
        misfit.pooled_misfit.
    previous : Array or None
        `packed` before the last prediction.

    """

    mode: Mode
    packed: Array
    sizes: tuple[int, int, int]
    log_likelihood: float = 0.0
    recent_log_likelihood: float = 0.0
    log_density: float = 0.0
    stated_log_density: float = 0.0
    mean_square: float = 1.0
    model: LinearisedModel | None = None
    passes: int = 0
    age: float = 0.0
    age_linearised: float = 0.0
    misfit: float = 1.0
    previous: Array | None = None
    x: Array = field(init=False)
    cov: Array = field(init=False)
    sensitivity: Array = field(init=False)
    beta: Array = field(init=False)
    beta_cov: Array = field(init=False)
    statistics: Array = field(init=False)
    noise_scale: Array = field(init=False)
    innovations: Array = field(init=False)
    reference: Array = field(init=False)

    def __post_init__(self) -> None:
        """Point the named arrays into `packed`."""
        (self.x, self.cov, self.sensitivity, self.beta, self.beta_cov, self.statistics,
         self.innovations) = unpack(self.packed, *self.sizes)
        self.noise_scale = self.statistics[:self.sizes[2]]
        self.reference = self.beta if self.model is None else self.model.reference

    def previous_buffer(self) -> Array:
        """Return the array into which a prediction copies `packed` first."""
        if self.previous is None:
            self.previous = np.empty_like(self.packed)
        return self.previous

    def undo_prediction(self) -> None:
        """Return to what was known before the last prediction, if there was one."""
        if self.previous is not None:
            self.packed[:] = self.previous

    def before_prediction(self) -> Filter:
        """Return an independent filter as this one was before its last prediction."""
        packed = self.packed if self.previous is None else self.previous
        return replace(self, packed=packed.copy(), previous=None)

    @property
    def state(self) -> Array:
        """Return the state at the estimated parameters, x + s (beta - reference), (n,)."""
        if self.model is None:
            return self.x
        return self.x + self.sensitivity @ (self.beta - self.reference)

    @property
    def mass(self) -> float:
        """Return the payload, kg."""
        return self.beta.item(MASS)

    @property
    def variance(self) -> float:
        """Return the variance of the payload, kg^2."""
        return self.beta_cov.item(MASS, MASS)

    def copy(self) -> Filter:
        """Return an independent filter that knows the same."""
        return replace(self, packed=self.packed.copy(), previous=None)
