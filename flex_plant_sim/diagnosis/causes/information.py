"""
The information that records have on a further cause of a given size, beside a set of causes.

It is what the arm's parts cannot undo, in the covariance of the evidence. A proposal's information
is neither: it is linear in the parts, which may follow a cause through several tolerances, and in
the innovations of each arm's own filter. `verdict.detection` turns it into limits.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
import math

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.gauss_newton import MAX_STEPS, MIN_STEP_GAIN
from flex_plant_sim.diagnosis.causes.hypothesis import Hypothesis
from flex_plant_sim.diagnosis.causes.refined_fit import COARSE_SAMPLES, RefinedFit
from flex_plant_sim.diagnosis.causes.sensitivity import SensitivityProbe
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.sufficient_statistics import TEMPER
import numpy as np

# Deviation of a part, in tolerances, up to which the residual is linear in it.
LINEAR_TOLERANCES = 0.5
# Share of the shapes of an effect that have less information than is stated.
LESS_SHARE = 0.25


@dataclass(frozen=True)
class InformationProbe:
    """
    Takes the information on further causes, with the causes of a set and the parts free.

    Attributes
    ----------
    likelihood : Likelihood
        Linearised around the set; of some windows.
    columns : Array
        Jacobian in the causes' values and in the parts, weighted, (k + p, m N).
    prior_widths : Array
        Prior standard deviations of both, (k + p,).
    weight : Array
        One over the standard deviation of each channel's errors, (m, 1).
    duration : float
        Of the longest record, s.

    """

    likelihood: Likelihood
    columns: Array
    prior_widths: Array
    weight: Array
    duration: float

    @classmethod
    def beside(cls, centre: RefinedFit) -> InformationProbe:
        """Return the probe beside a set."""
        likelihood, fit = centre.likelihood.thinned(COARSE_SAMPLES), centre.fit
        ratio = likelihood.weight / centre.likelihood.weight
        of_values = np.sqrt(ratio) * centre.point.jacobian[..., likelihood.kept_samples]
        weight = 1.0 / (fit.error_scale * np.sqrt(TEMPER))[:, None]
        columns = np.concatenate([of_values, likelihood.part_jacobian]) * weight
        return cls(likelihood, columns.reshape(len(columns), -1),
                   np.concatenate([fit.statistics.widths, likelihood.tolerances]), weight,
                   centre.causes.duration)

    def __call__(self, hypothesis: Hypothesis, deviation: float) -> float:
        """
        Return the information on the first size of a cause that deviates so far, 1 / unit^2.

        Twice the nats that causes and parts at their best leave of what it changes, over its
        square. NaN where no prediction is finite.
        """
        changes = self._changes(hypothesis, deviation)
        if not changes:
            return math.nan
        linear = [self._linear(change, self.columns, self._precision)[1] for change in changes]
        chosen = int(np.argsort(linear)[int(LESS_SHARE * len(linear))])
        return 2.0 * self._left(changes[chosen]) / deviation**2

    def _changes(self, hypothesis: Hypothesis, deviation: float) -> list[Array]:
        """Return what a deviation of the first size changes, weighted, at each shape, (m N,)."""
        probed, first = hypothesis.probe_deviations()[0], int(np.argmax(hypothesis.is_size))
        take = SensitivityProbe(self.likelihood).sensitivities
        found = take(hypothesis, probed * deviation / probed[first])
        # A contact may change the arm at null already: bristles bend under other friction, too.
        null = take(hypothesis, 0.0 * probed) if hypothesis.effect.contact else []
        at_null = {tuple(s.shape): s.changes[0] for s in null}
        return [((s.changes[0] - at_null.get(tuple(s.shape), 0.0)).reshape(len(self.weight), -1)
                 * self.weight).ravel() for s in found]

    @cached_property
    def _precision(self) -> Array:
        """Return the precision of causes and parts, (k + p, k + p)."""
        return self._precision_with(self.columns)

    def _precision_with(self, columns: Array) -> Array:
        return np.asarray(columns @ columns.T + np.diag(self.prior_widths**-2.0), dtype=float)

    def _linear(self, change: Array, columns: Array, precision: Array) -> tuple[Array, float]:
        """Return what of causes and parts undoes a change best, (k + p,), and what is left."""
        step = np.asarray(np.linalg.solve(precision, columns @ change), dtype=float)
        return step, self._nats(change - columns.T @ step, step)

    def _nats(self, left: Array, deviations: Array) -> float:
        return 0.5 * float(left @ left + np.sum((deviations / self.prior_widths)**2))

    def _left(self, change: Array) -> float:
        """
        Return what causes and parts at their best leave of a change, nats.

        Gauss-Newton steps from the best values so far, each with the residual exact in the parts
        and Broyden's update of their Jacobian. What they end with is an upper bound.
        """
        columns = self.columns.copy()
        trial, promised = self._linear(change, columns, self._precision)
        parts = slice(len(trial) - len(self.likelihood.parts), None)
        if np.max(np.abs(trial / self.prior_widths)[parts], initial=0.0) <= LINEAR_TOLERANCES:
            return promised
        best, moved_best, least = np.zeros_like(trial), np.zeros_like(change), math.inf
        for _ in range(MAX_STEPS):
            moved, by = self._moved(trial, parts), (trial - best) / self.prior_widths
            columns += np.outer(by / (by @ by) / self.prior_widths,
                                moved - moved_best - columns.T @ (trial - best))
            found = self._nats(change - moved, trial)
            if found < least:
                best, moved_best, least = trial, moved, found
            trial, promised = self._linear(change - moved_best + columns.T @ best, columns,
                                           self._precision_with(columns))
            if least - promised < MIN_STEP_GAIN:
                break
        return least

    def _moved(self, step: Array, parts: slice) -> Array:
        """Return the exact change of the residual by the parts, linear in the causes, (m N,)."""
        likelihood = self.likelihood
        there = likelihood.whitened_residual(
            likelihood.centre_effects, likelihood.centre_deviations + step[parts])[0]
        change = there - likelihood.centre_residual - likelihood.centre_shift
        return np.asarray((change * self.weight).ravel()
                          + self.columns[:parts.start].T @ step[:parts.start])
