"""
The information that records have on a further cause of a given size, beside a set of causes.

It is what the arm's parts cannot undo, in the covariance of the evidence. A proposal's information
is neither: it is linear in the parts, which may follow a cause through several tolerances, and in
the innovations of each arm's own filter. `verdict.detection` turns it into limits.
"""

from __future__ import annotations

from dataclasses import dataclass, field
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

# Changes of the residual by the shape of the effect, (m N,) each.
_Changes = dict[tuple[float, ...], Array]


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
    _nulls: dict[Hypothesis, _Changes] = field(default_factory=dict, repr=False)

    @classmethod
    def beside(cls, centre: RefinedFit) -> InformationProbe:
        """Return the probe beside a set."""
        likelihood, fit = centre.likelihood.thinned(COARSE_SAMPLES), centre.fit
        ratio = likelihood.weight / centre.likelihood.weight
        of_values = np.sqrt(ratio) * centre.point.jacobian[..., likelihood.kept_samples]
        weight = 1.0 / (fit.error_scale * np.sqrt(TEMPER))[:, None]
        columns = np.concatenate([of_values, likelihood.part_jacobian]) * weight
        return cls(likelihood, columns.reshape(len(columns), likelihood.centre_residual.size),
                   np.concatenate([fit.statistics.widths, likelihood.tolerances]), weight,
                   centre.causes.duration)

    def __call__(self, hypothesis: Hypothesis, deviation: float) -> float:
        """
        Return the information on the first size of a cause that deviates so far, 1 / unit^2.

        Twice the nats that causes and parts at their best leave of what it changes, over its
        square. NaN where no prediction is finite.
        """
        changes = self._changes(hypothesis, deviation)
        if not len(changes):
            return math.nan
        linear = self._linear(changes.T, self.columns, self._precision)[1]
        chosen = int(np.argsort(linear)[int(LESS_SHARE * len(linear))])
        return 2.0 * self._left(changes[chosen]) / deviation**2

    def _changes(self, hypothesis: Hypothesis, deviation: float) -> Array:
        """Return what a deviation of the first size changes, weighted, at each shape, (L, m N)."""
        found = self._taken(hypothesis, deviation)
        # A contact may change the arm at null already: bristles bend under other friction, too.
        null = self._at_null(hypothesis) if hypothesis.effect.contact else {}
        return np.array([((change - null.get(shape, 0.0)).reshape(len(self.weight), -1)
                          * self.weight).ravel() for shape, change in found.items()])

    def _taken(self, hypothesis: Hypothesis, deviation: float) -> _Changes:
        """Return what a deviation of the first size changes, by shape."""
        probed, first = hypothesis.probe_deviations()[0], int(np.argmax(hypothesis.is_size))
        found = SensitivityProbe(self.likelihood).sensitivities(
            hypothesis, probed * deviation / probed[first], first_size=True)
        return {tuple(s.shape): s.changes[0] for s in found}

    def _at_null(self, hypothesis: Hypothesis) -> _Changes:
        """Return the same at null, taken once for all deviations that are asked about."""
        if hypothesis not in self._nulls:
            self._nulls[hypothesis] = self._taken(hypothesis, 0.0)
        return self._nulls[hypothesis]

    @cached_property
    def _precision(self) -> Array:
        """Return the precision of causes and parts, (k + p, k + p)."""
        return self._precision_with(self.columns)

    def _precision_with(self, columns: Array) -> Array:
        return np.asarray(columns @ columns.T + np.diag(self.prior_widths**-2.0), dtype=float)

    def _linear(self, changes: Array, columns: Array, precision: Array) -> tuple[Array, Array]:
        """
        Return what of causes and parts undoes changes best, and the nats that are left.

        Of one change (m N,), (k + p,) and a number; of changes (m N, L), (k + p, L) and (L,).
        """
        step = np.asarray(np.linalg.solve(precision, columns @ changes), dtype=float)
        return step, self._nats(changes - columns.T @ step, step)

    def _nats(self, left: Array, deviations: Array) -> Array:
        of_each = deviations.T / self.prior_widths
        return np.asarray(0.5 * (np.sum(left**2, axis=0) + np.sum(of_each**2, axis=-1)))

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
            return float(promised)
        best, moved_best, least = np.zeros_like(trial), np.zeros_like(change), math.inf
        for _ in range(MAX_STEPS):
            moved, by = self._moved(trial, parts), (trial - best) / self.prior_widths
            columns += np.outer(by / (by @ by) / self.prior_widths,
                                moved - moved_best - columns.T @ (trial - best))
            found = float(self._nats(change - moved, trial))
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
