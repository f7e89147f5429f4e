"""Fit a hypothesis by Levenberg-Marquardt, base parameters projected out within tolerance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.held_out.hypothesis import Hypothesis
from flex_plant_sim.diagnosis.held_out.problem import Problem, Weighting
from flex_plant_sim.diagnosis.prediction.predictor import Base
from flex_plant_sim.diagnosis.record.windows import Windows
import numpy as np

ITERATIONS = 8
FIRST_STEPS = 2
REWEIGHTINGS = 2
BATCH = 8
KEPT_STARTS = 2
ENOUGH = 0.3
SHARE = 1e-4
RIDGE = 1e-4
RELINEARISATIONS = 5
NEAR_NATS, NEAR = 3.0, 0.02
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
        Deviations of the base parameters from the robot file, (p,).
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
        white = weighting.white_columns(problem.sensitivity)
        self.columns = white.reshape(-1, white.shape[-1]) / np.sqrt(weighting.temper)
        self.offset = self.columns @ problem.start
        self.gram = self.columns.T @ self.columns + np.diag(problem.precision)
        self.bound = LIMIT / np.sqrt(problem.precision)

    def flat(self, residual: Array) -> Array:
        """Return tempered whitened residuals, flat, as if all deviations were zero: (…, M)."""
        return self.white(residual) - self.offset

    def white(self, residual: Array) -> Array:
        """Return tempered whitened differences of residuals, flat: (…, M = W length m)."""
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

    def at(self, flat: Array, deviations: Array) -> float:
        """Return the cost that linear prediction promises at deviations (p,), nats."""
        return float(0.5 * (flat @ flat) + (self.columns.T @ flat) @ deviations
                     + 0.5 * deviations @ self.gram @ deviations)

    def cost(self, flat: Array) -> float:
        """Return half the squared residual that the base parameters leave, nats; or inf."""
        if not np.all(np.isfinite(flat)):
            return np.inf
        return self.at(flat, self.nuisance(flat)[0])

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
        flat = projector.flat(problem.nominal)
        nuisance, free = projector.nuisance(flat)
        residual = problem.nominal + problem.sensitivity @ (nuisance - problem.start)
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
    starts, flat = hypothesis.starts(duration), projector.flat(problem.nominal)
    costs, kept, gains = [], np.zeros((0, flat.size)), np.zeros(0)
    for k in range(0, len(starts), BATCH):
        moved = projector.flat(search.residual(starts[k:k + BATCH]))
        costs += [projector.cost(f) for f in moved]
        change = moved[np.all(np.isfinite(moved), axis=1)] - flat
        kept = np.concatenate([kept, change])
        gains = np.concatenate([gains, [projector.gain(flat, d[None]) for d in change]])
        best = np.argsort(-gains)[:BATCH]
        kept, gains = kept[best], gains[best]
    most = max(projector.gain(flat, kept), projector.cost(flat) - min(costs, default=np.inf))
    return Promise(hypothesis, most, starts[np.argsort(costs)[:KEPT_STARTS]])


def settle(base: Base, windows: Sequence[Windows], noise: Sequence[Array]
           ) -> tuple[Problem, Fit]:
    """
    Return a base and its fit, linearised anew while its parameters are far from where they were.

    Far is where the true prediction errors miss what the linear ones promised.
    """
    problem = Problem(base, windows, noise)
    fit = fit_base(problem)
    for _ in range(RELINEARISATIONS):
        moved = np.where([n.settles for n in problem.nuisances], fit.nuisance, 0.0)
        better = _worth_moving(problem, fit, moved)
        if better is None:
            break
        problem = Problem(replace(base, deviations=tuple(map(float, better))), windows, noise)
        fit = fit_base(problem)
    return problem, fit


def _worth_moving(problem: Problem, fit: Fit, moved: Array) -> Array | None:
    """Return deviations (p,) to linearise at, or None where the present ones do."""
    projector, gains = Projector(problem, fit.weighting), problem.gains(())
    flat = projector.flat(problem.nominal)
    promised = projector.at(flat, moved)
    trials = [problem.start + share * (moved - problem.start) for share in (1.0, 0.5, 0.25)]
    costs = []
    for trial in trials:
        white = projector.white(problem.residual((), trial, gains)[0])
        costs.append(float(0.5 * (white @ white + trial @ (problem.precision * trial)))
                     if np.all(np.isfinite(white)) else np.inf)
        if costs[-1] - promised < NEAR_NATS + NEAR * promised:
            break
    best = int(np.argmin(costs))
    if best == 0 and costs[0] - promised < NEAR_NATS + NEAR * promised:
        return None
    return trials[best] if costs[best] < projector.at(flat, problem.start) else None


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
        flat = self.projector.flat(self.residual(values))
        return np.array([self.projector.cost(f) for f in flat])

    def linearise(self, values: Array) -> _Point:
        """Return residual and columns at values, by differences."""
        step = self.hypothesis.steps(values)
        moved = values + np.concatenate([np.zeros((1, len(values))), np.diag(step)])
        residual = self.residual(moved)
        if not np.all(np.isfinite(residual)):
            raise np.linalg.LinAlgError(f'{self.hypothesis.label}: no finite prediction')
        flat = self.projector.flat(residual[0])
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
        residual = point.residual + sensitivity @ (nuisance - self.problem.start)
        return Fit(self.hypothesis, point.values, nuisance, residual,
                   np.moveaxis(point.columns, 0, -1), sensitivity, precision,
                   self.projector.weighting, point.cost)
