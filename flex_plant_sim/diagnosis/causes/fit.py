"""Fit a set of causes with the parts of the arm: its evidence, its values, how sure they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.hypothesis import Hypothesis
from flex_plant_sim.diagnosis.likelihood.evidence import Marginal, Slab
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.prediction.discrepancy import Amplitude
from flex_plant_sim.effects.base import Effect
import numpy as np

ITERATIONS = 6
BATCH = 8
# A step that promises less is not worth a pass, nats.
ENOUGH = 0.05
DAMPINGS = (1e-4, 0.1, 10.0)


class Causes:
    """
    Some hypotheses at once; their parameters lie side by side, (k,).

    Parameters
    ----------
    hypotheses : sequence of Hypothesis
    duration : float
        Of the longest record, s.

    """

    def __init__(self, hypotheses: Sequence[Hypothesis], duration: float):
        self.hypotheses, self.duration = tuple(hypotheses), duration
        self.ends = np.cumsum([0, *(len(h.parameters) for h in self.hypotheses)])

    def _joined(self, parts: Sequence[Array]) -> Array:
        return np.concatenate([np.zeros(0), *parts])

    @cached_property
    def slab(self) -> Slab:
        """Return the prior of all parameters."""
        slabs = [h.slab(self.duration) for h in self.hypotheses]
        return Slab(*(self._joined([getattr(s, part) for s in slabs])
                      for part in ('centre', 'width', 'sided')))

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Return the lower and the upper bounds, (k,) each."""
        return (self._joined([h.low for h in self.hypotheses]),
                self._joined([h.high for h in self.hypotheses]))

    @property
    def structural(self) -> bool:
        """Tell whether values must come one by one."""
        return any(h.effect.structural for h in self.hypotheses)

    def split(self, values: Array) -> list[Array]:
        """Return values (…, k) as each hypothesis has them."""
        return [values[..., a:b] for a, b in zip(self.ends, self.ends[1:])]

    def effects(self, values: Array) -> tuple[Effect, ...]:
        """Return the effects with values (k,), or batches of them with (B, k)."""
        return tuple(h.at(v) for h, v in zip(self.hypotheses, self.split(values)))

    def steps(self, values: Array) -> Array:
        """Return difference steps at values, (k,)."""
        return self._joined([h.steps(v) for h, v in zip(self.hypotheses, self.split(values))])

    def residual(self, likelihood: Likelihood, values: Array) -> Array:
        """Return the residuals at values (B, k): (B, M)."""
        if self.structural or not self.hypotheses:
            return np.concatenate([likelihood.residual(self.effects(v)) for v in values])
        return np.concatenate([likelihood.residual(self.effects(values[k:k + BATCH]))
                               for k in range(0, len(values), BATCH)])


@dataclass(frozen=True)
class Fit:
    """
    A set of causes, fitted.

    Attributes
    ----------
    hypotheses : tuple of Hypothesis
        None for `nothing`, and for `unknown` alone.
    discrepancy : Amplitude
        Of the likelihood; a large one is `unknown`.
    values : Array
        Most probable ones, (k,).
    deviations : Array
        Of the parts, posterior mean, (p,).
    scale : Array
        By how much errors exceed what the filter states, (m,).
    covariance : Array
        Of (values, deviations), (k + p, k + p).
    log_evidence : float
        Nats, less that of white noise; -inf where nothing finite is predicted.

    """

    hypotheses: tuple[Hypothesis, ...]
    discrepancy: Amplitude
    values: Array
    deviations: Array
    scale: Array
    covariance: Array
    log_evidence: float


@dataclass(frozen=True)
class Point:
    """A linearisation: values (k,), undeviated residual (M,), its columns (M, k), the cost."""

    values: Array
    residual: Array
    columns: Array
    cost: float


class Descent:
    """Gauss-Newton with damping over the values of some causes, parts integrated out."""

    def __init__(self, likelihood: Likelihood, causes: Causes):
        self.likelihood, self.causes, self.slab = likelihood, causes, causes.slab
        self.marginal = likelihood.parts_marginal

    def costs(self, values: Array) -> Array:
        """Return minus the log-posterior at values (B, k), nats, (B,)."""
        white = self.likelihood.undeviated(self.causes.residual(self.likelihood, values))
        return np.array([self._cost(*row) for row in zip(white, values)])

    def _cost(self, white: Array, values: Array) -> float:
        away = (values - self.slab.centre) / self.slab.width
        return 0.5 * self.marginal.quadratic(white) + 0.5 * float(away @ away)

    def linearise(self, values: Array) -> Point:
        """
        Return residual and columns at values, by differences.

        Raises
        ------
        LinAlgError
            Where the prediction is not finite.

        """
        step = self.causes.steps(values)
        moved = values + np.concatenate([np.zeros((1, len(values))), np.diag(step)])
        white = self.likelihood.undeviated(self.causes.residual(self.likelihood, moved))
        if not np.all(np.isfinite(white)):
            raise np.linalg.LinAlgError('no finite prediction')
        columns = ((white[1:] - white[0]) / step[:, None]).T
        return Point(values, white[0], columns, self._cost(white[0], values))

    def run(self, starts: Sequence[Array]) -> Point:
        """Return the minimum found from the best of some starts, linearised there."""
        first = starts[0]
        if len(starts) > 1:
            first = starts[int(np.argmin(self.costs(np.stack(starts))))]
        point = self.linearise(first)
        for _ in range(ITERATIONS if len(first) else 0):
            better = self._next(point)
            if better is None:
                break
            point = self.linearise(better)
        return point

    def _next(self, point: Point) -> Array | None:
        """Return better values within the bounds, or None where little is to be gained."""
        low, high = self.causes.bounds
        rows = point.columns.T
        hessian = self.marginal.inner(rows, rows) + np.diag(self.slab.width**-2.0)
        gradient = (self.marginal.inner(rows, point.residual[None])[:, 0]
                    + (point.values - self.slab.centre) / self.slab.width**2)
        for damping in DAMPINGS:
            damped = hessian + damping * np.diag(np.diagonal(hessian))
            trial = np.clip(point.values - np.linalg.solve(damped, gradient), low, high)
            change = trial - point.values
            if -(gradient @ change + 0.5 * change @ hessian @ change) < ENOUGH:
                return None
            # Half the step as well: beyond a clip (a payload below zero) nothing changes.
            trials = np.stack([trial, point.values + 0.5 * change])
            costs = self.costs(trials)
            if costs.min() < point.cost - 0.1 * ENOUGH:
                return trials[int(np.argmin(costs))]
        return None

    def fit(self, point: Point) -> Fit:
        """Return the evidence at a point by Laplace's method, exact where all is linear."""
        wide = self.marginal.joined(point.columns, self.slab.width)
        away = point.values - self.slab.centre
        plain = point.residual - point.columns @ away
        mean, covariance, k = wide.mean(plain), wide.covariance, away.size
        # At the point; where a value lies at the end of a one-sided slab, at the optimum beyond.
        ends = (self.slab.sided != 0.0) & (away == 0.0)
        at = wide.quadratic(plain) if ends.any() else self.marginal.quadratic(
            point.residual) + float(np.sum((away / self.slab.width)**2))
        evidence = -0.5 * at - wide.half_log_determinant - self.likelihood.surprise()
        evidence += self.slab.log_inside(np.where(ends, mean[:k], away),
                                         np.diagonal(covariance)[:k])
        deviations = self.marginal.mean(point.residual) if k else mean
        left = point.residual + self.likelihood.columns @ deviations
        return Fit(self.causes.hypotheses, self.likelihood.base.discrepancy, point.values,
                   deviations, self.likelihood.scale_of(left), covariance, float(evidence))


def fitted(likelihood: Likelihood, causes: Causes, starts: Sequence[Array]) -> Fit:
    """Return causes fitted around a likelihood's linearisation, from the best of some starts."""
    descent = Descent(likelihood, causes)
    return descent.fit(descent.run(starts))


def joined_marginal(likelihood: Likelihood, causes: Causes, values: Array
                    ) -> tuple[Marginal, Array]:
    """Return the marginal over causes and parts, and the residual (M,) at their centres."""
    descent = Descent(likelihood, causes)
    point = descent.linearise(values)
    return (descent.marginal.joined(point.columns, causes.slab.width),
            point.residual - point.columns @ (values - causes.slab.centre))
