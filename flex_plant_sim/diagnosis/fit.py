"""Fit a hypothesis by Levenberg-Marquardt, base parameters projected out within tolerance."""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm_model import Array
from flex_plant_sim.diagnosis.hypothesis import Hypothesis
from flex_plant_sim.diagnosis.problem import Problem, Weighting
import numpy as np

ITERATIONS = 8
BATCH = 24
DIFFERENCE = 0.05
KEPT_STARTS = 2
ENOUGH = 0.05


@dataclass(frozen=True)
class Fit:
    """
    A fitted hypothesis (or the base alone, without values).

    Attributes
    ----------
    hypothesis : Hypothesis or None
    values : Array
        (k,).
    nuisance : Array
        Deviations of the base parameters, (p,).
    residual : Array
        One-step prediction errors with both, (W, length, m).
    directions : Array
        d residual / d (values, nuisance), (W, length, m, k + p).
    precision : Array
        Of the priors on (values, nuisance), (k + p,); zero for values.
    weighting : Weighting
    cost : float
        Negative log-posterior at the weighting, nats.

    """

    hypothesis: Hypothesis | None
    values: Array
    nuisance: Array
    residual: Array
    directions: Array
    precision: Array
    weighting: Weighting
    cost: float


class Projector:
    """Takes the base parameters out of whitened residuals, as far as their priors allow."""

    def __init__(self, problem: Problem, weighting: Weighting):
        self.weighting = weighting
        white = weighting.whitener @ problem.sensitivity
        self.columns = white.reshape(-1, white.shape[-1]) / np.sqrt(weighting.temper)
        gram = self.columns.T @ self.columns + np.diag(problem.precision)
        self.factor = np.linalg.inv(gram)

    def white(self, residual: Array) -> Array:
        """Return tempered whitened residuals, flat: (…, W length m)."""
        flat = self.weighting.white(residual) / np.sqrt(self.weighting.temper)
        return flat.reshape(residual.shape[:-3] + (-1,))

    def nuisance(self, flat: Array) -> Array:
        """Return the best deviations of the base parameters, (p,)."""
        return -self.factor @ (self.columns.T @ flat)

    def cost(self, flat: Array) -> float:
        """Return half the squared residual that the base parameters leave, nats."""
        load = self.columns.T @ flat
        return float(0.5 * (flat @ flat - load @ self.factor @ load))

    def normal(self, flat: Array, columns: Array) -> tuple[Array, Array]:
        """Return Hessian (k, k) and gradient (k,) of the cost for columns (k, M)."""
        cross = columns @ self.columns
        hessian = columns @ columns.T - cross @ self.factor @ cross.T
        gradient = columns @ flat - cross @ (self.factor @ (self.columns.T @ flat))
        return hessian, gradient


def fit_base(problem: Problem) -> Fit:
    """Return the base with its parameters re-estimated within tolerance."""
    weighting = problem.weighting(problem.nominal)
    for _ in range(3):
        projector = Projector(problem, weighting)
        flat = projector.white(problem.nominal)
        nuisance = projector.nuisance(flat)
        residual = problem.nominal + problem.sensitivity @ nuisance
        weighting = problem.weighting(residual)
    return Fit(None, np.zeros(0), nuisance, residual, problem.sensitivity, problem.precision,
               weighting, projector.cost(flat))


def fit_hypothesis(problem: Problem, hypothesis: Hypothesis, weighting: Weighting,
                   duration: float) -> Fit:
    """
    Return the best fit from all starts, weighted first as given, then as it asks for itself.

    Parameters
    ----------
    duration : float
        Of the longest record, s.

    """
    search = _Search(problem, hypothesis, Projector(problem, weighting))
    values = search.best_starts(hypothesis.starts(duration))
    tried = [search.descend(v) for v in values]
    best = min(tried, key=lambda pair: pair[1])[0]
    for _ in range(2):
        residual = search.residual(best[None])[0]
        nuisance = search.projector.nuisance(search.projector.white(residual))
        own = problem.weighting(residual + problem.sensitivity @ nuisance)
        search = _Search(problem, hypothesis, Projector(problem, own))
        best, cost = search.descend(best)
    return search.result(best, cost)


class _Search:
    """Levenberg-Marquardt for one hypothesis and one weighting."""

    def __init__(self, problem: Problem, hypothesis: Hypothesis, projector: Projector):
        self.problem, self.hypothesis, self.projector = problem, hypothesis, projector
        self._gains = None

    def residual(self, values: Array) -> Array:
        """Return residuals at values (B, k): (B, W, length, m)."""
        if self.hypothesis.effect.structural:
            return np.concatenate([
                self.problem.residual([self.hypothesis.at(v)]) for v in values])
        parts = [self.problem.residual([self.hypothesis.at(values[k:k + BATCH])])
                 for k in range(0, len(values), BATCH)]
        return np.concatenate(parts)

    def costs(self, values: Array) -> Array:
        """Return the cost at values (B, k): (B,)."""
        flat = self.projector.white(self.residual(values))
        return np.array([self.projector.cost(f) if np.all(np.isfinite(f)) else np.inf
                         for f in flat])

    def best_starts(self, starts: Array) -> Array:
        """Return the most promising starts, (<= KEPT_STARTS, k)."""
        if len(starts) <= KEPT_STARTS:
            return starts
        return starts[np.argsort(self.costs(starts))[:KEPT_STARTS]]

    def linearise(self, values: Array) -> tuple[Array, Array]:
        """Return residual (W, length, m) and columns (k, W, length, m) by differences."""
        away = np.abs(values - self.hypothesis.null)
        step = DIFFERENCE * np.maximum(away, 0.2 * self.hypothesis.scale)
        step = np.where(values + step > self.hypothesis.high, -step, step)
        moved = values + np.concatenate([np.zeros((1, len(values))), np.diag(step)])
        residual = self.residual(moved)
        columns = (residual[1:] - residual[0]) / step[:, None, None, None]
        return residual[0], columns

    def descend(self, values: Array) -> tuple[Array, float]:
        """Return the minimum found from a start, and its cost."""
        damping, cost = 1e-3, np.inf
        for _ in range(ITERATIONS):
            residual, columns = self.linearise(values)
            flat = self.projector.white(residual)
            before = self.projector.cost(flat)
            hessian, gradient = self.projector.normal(flat, self.projector.white(columns))
            values_next, cost = self._step(values, before, hessian, gradient, damping)
            done = before - cost < ENOUGH
            values = values_next
            if done:
                break
        return values, cost

    def _step(self, values: Array, before: float, hessian: Array, gradient: Array,
              damping: float) -> tuple[Array, float]:
        """Return the best of a few damped steps within the bounds, and its cost."""
        diagonal = np.diag(np.maximum(np.diagonal(hessian), 1e-12))
        factors = damping * 30.0**np.arange(4)
        trials = []
        for factor in factors:
            change = -np.linalg.lstsq(hessian + factor * diagonal, gradient, rcond=None)[0]
            trials.append(np.clip(values + change, self.hypothesis.low, self.hypothesis.high))
        for trial in trials:
            cost = self.costs(trial[None])[0]
            if cost < before:
                return trial, cost
        return values, before

    def result(self, values: Array, cost: float) -> Fit:
        """Return the fit at final values."""
        residual, columns = self.linearise(values)
        nuisance = self.projector.nuisance(self.projector.white(residual))
        sensitivity = self.problem.sensitivity
        directions = np.concatenate([np.moveaxis(columns, 0, -1), sensitivity], axis=-1)
        precision = np.concatenate([np.zeros(len(values)), self.problem.precision])
        return Fit(self.hypothesis, values, nuisance, residual + sensitivity @ nuisance,
                   directions, precision, self.projector.weighting, cost)
