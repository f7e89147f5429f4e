"""Fit a set of causes with the parts of the arm: its values, its evidence, how sure it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.hypothesis import Hypothesis
from flex_plant_sim.diagnosis.likelihood.evidence import (
    channel_products,
    not_surer_than_windows,
    Slab,
)
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.moments import Moments, TEMPER
from flex_plant_sim.diagnosis.likelihood.prior import FAR_OFF, HELD, spoken_for
from flex_plant_sim.diagnosis.prediction.discrepancy import Amplitude
from flex_plant_sim.effects.base import Effect
import numpy as np
from scipy.optimize import lsq_linear

ITERATIONS, ROUGH = 8, 3
BATCH = 8
# A step that promises less is not worth a pass, nats.
ENOUGH = 0.3
# Errors that exceed what is stated by less leave nothing to explain.
EXCESS = 1.05
DAMPINGS = (1e-4, 0.1, 10.0)
NO_SLAB = Slab(*np.zeros((4, 0)))


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
                      for part in ('centre', 'width', 'sided', 'spiked')))

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Return the lower and the upper bounds, (k,) each."""
        return (self._joined([h.low for h in self.hypotheses]),
                self._joined([h.high for h in self.hypotheses]))

    @property
    def structural(self) -> bool:
        """Tell whether values must come one by one."""
        return any(h.effect.structural for h in self.hypotheses)

    def tolerances(self, likelihood: Likelihood) -> Array:
        """Return the parts' tolerances beside the causes, (p,)."""
        held = spoken_for(likelihood.base.robot, likelihood.parts,
                          {h.label for h in self.hypotheses})
        return np.where(held, HELD, 1.0) * likelihood.tolerances

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
        """Return the residuals at values (B, k): (B, m, N)."""
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
        Of (values, deviations), (k + p, k + p); no surer than windows agree where much is left.
    moments : Moments
        From which all of this follows.
    log_evidence : float
        Nats, less that of white noise; -inf where nothing finite is predicted.

    """

    hypotheses: tuple[Hypothesis, ...]
    discrepancy: Amplitude
    values: Array
    deviations: Array
    scale: Array
    covariance: Array
    moments: Moments
    log_evidence: float


@dataclass(frozen=True)
class Point:
    """
    A linearisation: values (k,), residual (m, N), its columns (k, m, N), the cost in nats.

    The cost is that at the likeliest scale of each channel, (m,).
    """

    values: Array
    residual: Array
    columns: Array
    scale: Array
    cost: float


def with_far_part(fit: Fit, name: str, place: int) -> Fit:
    """Return a fit as it is judged with one part that is not as its file says."""
    tolerances = fit.moments.tolerances.copy()
    tolerances[place] *= FAR_OFF
    moments = replace(fit.moments, tolerances=tolerances)
    scale = moments.scaled()
    return replace(fit, discrepancy=replace(fit.discrepancy, far=name), scale=scale,
                   deviations=moments.parts(scale).mean, moments=moments,
                   covariance=moments.joined(scale).covariance,
                   log_evidence=moments.log_evidence(scale))


class Descent:
    """
    Gauss-Newton with damping over the values of some causes, parts integrated out.

    Columns are taken by differences where it starts and where a step fails, and corrected in
    between by what each step shows: C. G. Broyden, Mathematics of Computation 19 (1965). So a
    step costs one pass.

    Parameters
    ----------
    likelihood : Likelihood
    causes : Causes
    scale : Array, optional
        By how much errors exceed what the filter states, (m,); the likeliest everywhere if not
        given.

    """

    def __init__(self, likelihood: Likelihood, causes: Causes, scale: Array | None = None):
        self.likelihood, self.causes, self.slab = likelihood, causes, causes.slab
        self.tolerances = causes.tolerances(likelihood)
        self.held = scale

    def _products(self, own: Array) -> Array:
        """Return products of own rows (a, m, N) and the parts' columns, (m, a + p, a + p)."""
        cross = channel_products(own, self.likelihood.columns)
        return np.block([[channel_products(own, own), cross],
                         [cross.transpose(0, 2, 1), self.likelihood.products]])

    def moments(self, point: Point) -> Moments:
        """Return the products at a point."""
        own = np.concatenate([point.residual[None], point.columns])
        return self._moments(own, point.values - self.slab.centre, self.slab)

    def _moments(self, own: Array, away: Array, slab: Slab) -> Moments:
        return Moments(self._products(own), away, slab, self.tolerances,
                       self.likelihood.weight * own.shape[-1], self.likelihood.surprise)

    def at(self, values: Array) -> tuple[Array, Array, float]:
        """
        Return residual (m, N), scale (m,) and cost at values, (k,).

        The cost is minus the log-posterior with the parts and the scales at their best, nats;
        infinite where nothing finite is predicted.
        """
        residual = self.residual(values)
        return residual, *self.costs(values, residual)

    def costs(self, values: Array, residual: Array) -> tuple[Array, float]:
        """Return scale (m,) and cost of a residual (m, N) at values, (k,)."""
        if not np.all(np.isfinite(residual)):
            return np.ones(len(residual)), float('inf')
        alone = self._moments(residual[None], np.zeros(0), NO_SLAB)
        scale = alone.scaled() if self.held is None else self.held
        away = (values - self.slab.centre) / self.slab.width
        cost = 0.5 * (alone.parts(scale).quadratic + float(away @ away))
        return scale, cost + alone.samples * float(np.sum(np.log(scale))) / TEMPER

    def residual(self, values: Array) -> Array:
        """Return the residual at values, (m, N)."""
        return self.causes.residual(self.likelihood, values[None])[0]

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Return the lower and the upper bounds, (k,) each."""
        return self.causes.bounds

    def linearise(self, values: Array, residual: Array, scale: Array, cost: float) -> Point:
        """
        Return the columns at values by differences.

        Raises
        ------
        LinAlgError
            Where the prediction is not finite.

        """
        columns = np.zeros((0, *residual.shape))
        if values.size:
            step = self.causes.steps(values)
            moved = self.causes.residual(self.likelihood, values + np.diag(step))
            columns = (moved - residual) / step[:, None, None]
        if not (np.isfinite(cost) and np.all(np.isfinite(columns))):
            raise np.linalg.LinAlgError('no finite prediction')
        return Point(values, residual, columns, scale, cost)

    def run(self, starts: Sequence[Array], rough: bool = False) -> Point:
        """
        Return the minimum found from the best of some starts, linearised near it.

        Where much is left, also from where each arm's own filter errs least.
        """
        point = self._down(starts, rough)
        if (self.likelihood.alike and point.values.size
                and np.any(self.moments(point).scaled() > EXCESS)):
            smooth = Descent(self.likelihood.smooth, self.causes, self.held)._down(starts, rough)
            point = min(point, self._down([smooth.values], rough), key=lambda p: p.cost)
        return point

    def _down(self, starts: Sequence[Array], rough: bool) -> Point:
        tried = [(start, *self.at(start)) for start in starts]
        point = self.linearise(*min(tried, key=lambda found: found[-1]))
        fresh, again = True, not rough
        for _ in range((ROUGH if rough else ITERATIONS) if point.values.size else 0):
            better = self.lower(point)
            if better is not None:
                point, fresh = better, False
            elif fresh or not again:
                break
            else:
                # What the corrections lack of the truth may have hidden a way down.
                point = self.linearise(point.values, point.residual, point.scale, point.cost)
                fresh, again = True, False
        return point

    def lower(self, point: Point) -> Point | None:
        """Return a better point within the bounds, or None where little is to be gained."""
        gradient, hessian = self.moments(point).profiled(point.scale)
        low, high = ((end - point.values) / self.slab.width for end in self.bounds)
        for damping in DAMPINGS:
            damped = hessian + damping * np.diag(np.diagonal(hessian))
            step = least_within(damped, gradient, low, high)
            if -float(gradient @ step + 0.5 * step @ hessian @ step) < ENOUGH:
                return None
            trial = np.clip(point.values + self.slab.width * step, *self.bounds)
            found = self.at(trial)
            if found[-1] < point.cost - 0.1 * ENOUGH:
                return self._corrected(point, trial, *found)
        return None

    def _corrected(self, point: Point, trial: Array, residual: Array, scale: Array, cost: float
                   ) -> Point:
        """Return the point after a step, its columns such that they tell what the step did."""
        step = (trial - point.values) / self.slab.width
        missed = residual - point.residual - np.tensordot(trial - point.values, point.columns, 1)
        columns = point.columns + (
            step / (step @ step) / self.slab.width)[:, None, None] * missed
        return Point(trial, residual, columns, scale, cost)

    def fit(self, point: Point) -> Fit:
        """Return the evidence at a point, at the scales that are likeliest there."""
        moments = self.moments(point)
        scale = moments.scaled()
        parts, covariance = moments.parts(scale).mean, moments.joined(scale).covariance
        if np.any(scale > EXCESS):
            # Larger errors than any model's are no white ones: they go with the motion.
            covariance = not_surer_than_windows(covariance, self._scores(point, parts, scale))
        return Fit(self.causes.hypotheses, self.likelihood.base.discrepancy, point.values, parts,
                   scale, covariance, moments, moments.log_evidence(scale))

    def _scores(self, point: Point, parts: Array, scale: Array) -> Array:
        """Return d ln p / d (values, parts) of each window, (k + p, W)."""
        columns = self.likelihood.columns
        left = -(point.residual + np.tensordot(parts, columns, 1)) / (TEMPER * scale**2)[:, None]
        windows = sum(p.windows.starts.size for p in self.likelihood.predictors)
        each = left.reshape(len(left), windows, -1)
        return np.concatenate([
            np.einsum('amwl,mwl->aw', rows.reshape(len(rows), *each.shape), each)
            for rows in (point.columns, columns)])


def least_within(hessian: Array, gradient: Array, low: Array, high: Array) -> Array:
    """
    Return the least of g's + s'H s / 2 with each s between its ends, (k,).

    A step that is cut at the ends afterwards need not lead down at all: D. P. Bertsekas, SIAM
    Journal on Control and Optimization 20 (1982).
    """
    step, free = np.zeros(len(gradient)), low < high
    if free.any():
        root = np.linalg.cholesky(hessian[np.ix_(free, free)])
        step[free] = lsq_linear(root.T, -np.linalg.solve(root, gradient[free]),
                                (low[free], high[free]), method='bvls').x
    return step


def fitted(likelihood: Likelihood, causes: Causes, starts: Sequence[Array],
           scale: Array | None = None, rough: bool = False) -> Fit:
    """Return causes fitted around a likelihood's linearisation, from the best of some starts."""
    scale = np.ones(len(likelihood.present)) if scale is None else scale
    descent = Descent(likelihood, causes, scale)
    return descent.fit(descent.run(starts, rough))
