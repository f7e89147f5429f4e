"""Fit a hypothesis by Levenberg-Marquardt, base parameters projected out within tolerance."""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm_model import Array
from flex_plant_sim.diagnosis.hypothesis import Hypothesis
from flex_plant_sim.diagnosis.problem import Problem, Weighting
import numpy as np

ITERATIONS = 8
FIRST_STEPS = 2
REWEIGHTINGS = 2
BATCH = 8
KEPT_STARTS = 2
ENOUGH = 0.3
SHARE = 1e-4
RIDGE = 1e-4
LIMIT = 3.0
WIDE = 30.0
DAMPINGS = (1e-4, 0.03, 1.0, 30.0)


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
    columns : Array
        d residual / d values, (W, length, m, k).
    sensitivity : Array
        d residual / d nuisance, (W, length, m, p): the problem's own, shared by all its fits.
    precision : Array
        Of the priors on (values, nuisance), (k + p,); next to nothing for values.
    weighting : Weighting
    cost : float
        Negative log-posterior at the weighting, nats.

    """

    hypothesis: Hypothesis | None
    values: Array
    nuisance: Array
    residual: Array
    columns: Array
    sensitivity: Array
    precision: Array
    weighting: Weighting
    cost: float

    @property
    def directions(self) -> Array:
        """Return d residual / d (values, nuisance), (W, length, m, k + p)."""
        return np.concatenate([self.columns, self.sensitivity], axis=-1)


class Projector:
    """
    Takes the base parameters out of whitened residuals, as far as their tolerances allow.

    Each has a Gaussian prior and stays within LIMIT standard deviations of nominal: a part
    further out than that is a cause to be named, not a tolerance.
    """

    def __init__(self, problem: Problem, weighting: Weighting):
        self.weighting = weighting
        white = weighting.whitener @ problem.sensitivity
        self.columns = white.reshape(-1, white.shape[-1]) / np.sqrt(weighting.temper)
        self.gram = self.columns.T @ self.columns + np.diag(problem.precision)
        self.bound = LIMIT / np.sqrt(problem.precision)

    def white(self, residual: Array) -> Array:
        """Return tempered whitened residuals, flat: (…, W length m)."""
        flat = self.weighting.white(residual) / np.sqrt(self.weighting.temper)
        return flat.reshape(residual.shape[:-3] + (-1,))

    def nuisance(self, flat: Array) -> tuple[Array, Array]:
        """Return the best deviations of the base parameters (p,), and which are free (p,)."""
        load = self.columns.T @ flat
        free, value = np.ones(load.size, dtype=bool), np.zeros(load.size)
        for _ in range(load.size):
            held = self.gram[np.ix_(free, ~free)] @ value[~free]
            value[free] = -np.linalg.solve(self.gram[np.ix_(free, free)], load[free] + held)
            beyond = free & (np.abs(value) > self.bound)
            if not beyond.any():
                break
            value = np.clip(value, -self.bound, self.bound)
            free = free & ~beyond
        return value, free

    def cost(self, flat: Array) -> float:
        """Return half the squared residual that the base parameters leave, nats; or inf."""
        if not np.all(np.isfinite(flat)):
            return np.inf
        value, _ = self.nuisance(flat)
        return float(0.5 * (flat @ flat) + (self.columns.T @ flat) @ value
                     + 0.5 * value @ self.gram @ value)

    def gain(self, flat: Array, directions: Array) -> float:
        """Return the nats that the best mixture of directions (k, M) takes off the cost."""
        hessian, gradient = self.normal(flat, directions)
        own = np.diag(RIDGE * np.diagonal(hessian) + 1e-12)
        return float(0.5 * gradient @ np.linalg.solve(hessian + own, gradient))

    def normal(self, flat: Array, columns: Array) -> tuple[Array, Array]:
        """Return Hessian (k, k) and gradient (k,) of the cost for columns (k, M)."""
        value, free = self.nuisance(flat)
        cross = (columns @ self.columns)
        own = cross[:, free]
        hessian = columns @ columns.T - own @ np.linalg.solve(
            self.gram[np.ix_(free, free)], own.T)
        return hessian, columns @ flat + cross @ value


def frozen_precision(problem: Problem, free: Array) -> Array:
    """Return the prior precision of the base parameters, those at a limit held there, (p,)."""
    return np.where(free, problem.precision, 1e12 * problem.precision)


def fit_base(problem: Problem) -> Fit:
    """Return the base with its parameters re-estimated within tolerance."""
    weighting = problem.weighting(problem.nominal)
    for _ in range(3):
        projector = Projector(problem, weighting)
        flat = projector.white(problem.nominal)
        nuisance, free = projector.nuisance(flat)
        residual = problem.nominal + problem.sensitivity @ nuisance
        weighting = problem.weighting(residual)
    precision = frozen_precision(problem, free)
    return Fit(None, np.zeros(0), nuisance, residual, np.zeros(residual.shape + (0,)),
               problem.sensitivity, precision, weighting, projector.cost(flat))


@dataclass(frozen=True)
class Promise:
    """
    What a hypothesis could explain at most, seen from its starts alone.

    Attributes
    ----------
    hypothesis : Hypothesis
    gain : float
        Nats, by the best mixture of what its starts do; of whole sizes, not of derivatives.
    starts : Array
        The most promising starts, (<= KEPT_STARTS, k).

    """

    hypothesis: Hypothesis
    gain: float
    starts: Array


def promise(problem: Problem, hypothesis: Hypothesis, projector: Projector,
            duration: float) -> Promise:
    """
    Return what the starts of a hypothesis promise.

    Starts at a time beyond the duration of the longest record, s, are left out.
    """
    search = _Search(problem, hypothesis, projector)
    starts, flat = hypothesis.starts(duration), projector.white(problem.nominal)
    costs, kept, gains = [], np.zeros((0, flat.size)), np.zeros(0)
    for k in range(0, len(starts), BATCH):
        moved = projector.white(search.residual(starts[k:k + BATCH]))
        costs += [projector.cost(f) for f in moved]
        change = moved[np.all(np.isfinite(moved), axis=1)] - flat
        kept = np.concatenate([kept, change])
        gains = np.concatenate([gains, [projector.gain(flat, d[None]) for d in change]])
        best = np.argsort(-gains)[:BATCH]
        kept, gains = kept[best], gains[best]
    most = max(projector.gain(flat, kept), projector.cost(flat) - min(costs, default=np.inf))
    return Promise(hypothesis, most, starts[np.argsort(costs)[:KEPT_STARTS]])


def explore(problem: Problem, promised: Promise, projector: Projector) -> Fit:
    """Return a first fit: the better of the promising starts after a few steps."""
    search = _Search(problem, promised.hypothesis, projector)
    points = [search.descend(v, FIRST_STEPS) for v in promised.starts]
    return search.result(min(points, key=lambda p: p.cost))


def refine(problem: Problem, fit: Fit) -> Fit:
    """Return a fit carried to its end, weighted as its own residual asks for."""
    for _ in range(REWEIGHTINGS):
        assert fit.hypothesis is not None
        weighting = problem.weighting(fit.residual)
        search = _Search(problem, fit.hypothesis, Projector(problem, weighting))
        fit = search.result(search.descend(fit.values, ITERATIONS))
    return fit


@dataclass(frozen=True)
class _Point:
    """A linearisation: values (k,), residual (W, length, m), columns (k, W, length, m)."""

    values: Array
    residual: Array
    columns: Array
    flat: Array
    cost: float


class _Search:
    """Levenberg-Marquardt for one hypothesis and one weighting."""

    def __init__(self, problem: Problem, hypothesis: Hypothesis, projector: Projector):
        self.problem, self.hypothesis, self.projector = problem, hypothesis, projector

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
        return np.array([self.projector.cost(f) for f in flat])

    def linearise(self, values: Array) -> _Point:
        """Return residual and columns at values, by differences."""
        step = self.hypothesis.steps(values)
        moved = values + np.concatenate([np.zeros((1, len(values))), np.diag(step)])
        residual = self.residual(moved)
        if not np.all(np.isfinite(residual)):
            raise np.linalg.LinAlgError(f'{self.hypothesis.label}: no finite prediction')
        flat = self.projector.white(residual[0])
        columns = (residual[1:] - residual[0]) / step[:, None, None, None]
        return _Point(values, residual[0], columns, flat, self.projector.cost(flat))

    def descend(self, values: Array, iterations: int) -> _Point:
        """Return the minimum found from a start, linearised there."""
        point = self.linearise(values)
        for _ in range(iterations):
            better = self._next(point)
            if better is None:
                break
            point = self.linearise(better)
        return point

    def _next(self, point: _Point) -> Array | None:
        """Return better values within the bounds, or None where little is to be gained."""
        columns = self.projector.white(point.columns)
        hessian, gradient = self.projector.normal(point.flat, columns)
        diagonal = np.diag(np.maximum(np.diagonal(hessian), 1e-12))
        for damping in DAMPINGS:
            change = -np.linalg.lstsq(hessian + damping * diagonal, gradient, rcond=None)[0]
            trial = np.clip(point.values + change, self.hypothesis.low, self.hypothesis.high)
            change = trial - point.values
            promised = -(gradient @ change + 0.5 * change @ hessian @ change)
            if promised < ENOUGH + SHARE * point.cost:
                return None
            # Half the step as well: beyond a clip (a payload below zero) nothing changes.
            trials = np.stack([trial, point.values + 0.5 * change])
            costs = self.costs(trials)
            if point.cost - costs.min() > 0.1 * promised:
                return trials[np.argmin(costs)]
        return None

    def result(self, point: _Point) -> Fit:
        """Return the fit at a point."""
        nuisance, free = self.projector.nuisance(point.flat)
        sensitivity = self.problem.sensitivity
        wide = (WIDE * self.hypothesis.scale)**-2
        precision = np.concatenate([wide, frozen_precision(self.problem, free)])
        return Fit(self.hypothesis, point.values, nuisance,
                   point.residual + sensitivity @ nuisance, np.moveaxis(point.columns, 0, -1),
                   sensitivity, precision, self.projector.weighting, point.cost)
