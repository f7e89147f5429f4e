"""Fit a set of causes with the parts of the arm: its values, its evidence, how sure it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
import math

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.hypothesis import Causes, Hypothesis
from flex_plant_sim.diagnosis.likelihood.constancy import by_window, gained
from flex_plant_sim.diagnosis.likelihood.evidence import (
    channel_products,
    Marginal,
    not_surer_than_windows,
)
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.moments import Moments, TEMPER
from flex_plant_sim.diagnosis.likelihood.prior import FAR_OFF
from flex_plant_sim.diagnosis.prediction.discrepancy import Amplitude
import numpy as np

# Steps at most, of a fit and of one that only ranks.
ITERATIONS, ROUGH = 8, 3
# A step that promises less is not worth a pass, nats.
ENOUGH = 0.3
# Errors that exceed what is stated by less leave nothing to explain.
EXCESS = 1.05
# Of Levenberg and Marquardt, tried until the cost falls.
DAMPINGS = (1e-4, 0.1, 10.0)


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
    changing : float
        What the evidence gains where one of the causes changes over the record, nats; -inf where
        that was not asked.
    by_window : Array
        ln p of each window at the values and the parts, but for what is the same in all, (W,).

    """

    hypotheses: tuple[Hypothesis, ...]
    discrepancy: Amplitude
    values: Array
    deviations: Array
    scale: Array
    covariance: Array
    moments: Moments
    log_evidence: float
    changing: float = -math.inf
    by_window: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Point:
    """A linearisation: values (k,), residual (m, N), its columns (k, m, N), the cost in nats."""

    values: Array
    residual: Array
    columns: Array
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
    scale : Array
        By how much errors exceed what the filter states, (m,).

    """

    def __init__(self, likelihood: Likelihood, causes: Causes, scale: Array):
        self.likelihood, self.causes, self.slab = likelihood, causes, causes.slab
        self.scale = scale

    def _products(self, own: Array) -> Array:
        """Return products of own rows (a, m, N) and the parts' columns, (m, a + p, a + p)."""
        cross = channel_products(own, self.likelihood.columns)
        return np.block([[channel_products(own, own), cross],
                         [cross.transpose(0, 2, 1), self.likelihood.products]])

    def moments(self, point: Point) -> Moments:
        """Return the products at a point."""
        own = np.concatenate([point.residual[None], point.columns])
        return Moments(self._products(own), point.values - self.slab.centre, self.slab,
                       self.likelihood.tolerances,
                       self.likelihood.weight * point.residual.shape[1],
                       self.likelihood.surprise)

    def cost(self, values: Array, residual: Array) -> float:
        """Return minus the log-posterior at values, nats; infinite where nothing is predicted."""
        if not np.all(np.isfinite(residual)):
            return float('inf')
        products = np.tensordot(1.0 / (TEMPER * self.scale**2),
                                self._products(residual[None]), 1)
        away = (values - self.slab.centre) / self.slab.width
        return 0.5 * (Marginal(products, self.likelihood.tolerances).quadratic
                      + float(away @ away))

    def at(self, values: Array) -> tuple[Array, float]:
        """Return residual (m, N) and cost at values, (k,)."""
        residual = self.causes.residual(self.likelihood, values[None])[0]
        return residual, self.cost(values, residual)

    def checked(self, point: Point, values: Array, deviations: Array) -> Point:
        """Return a point's columns at other values, exact there with deviations, (p,)."""
        exact = self.likelihood.at(self.causes.effects(values), deviations)[0]
        residual = exact - np.tensordot(deviations, self.likelihood.columns, 1)
        return Point(values, residual, point.columns, self.cost(values, residual))

    def linearise(self, values: Array, residual: Array, cost: float) -> Point:
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
        with np.errstate(over='ignore'):
            # What diverges may be finite at the last sample, and yet its products are not.
            power = float(np.sum(columns**2))
        if not (np.isfinite(cost) and np.isfinite(power)):
            raise np.linalg.LinAlgError('no finite prediction')
        return Point(values, residual, columns, cost)

    def run(self, starts: Sequence[Array], rough: bool = False) -> Point:
        """
        Return the minimum found from the best of some starts, linearised near it.

        What takes its time is tried from all of it at once, too: between are side valleys.
        """
        point = self.down(starts, rough)
        sudden = self.causes.sudden(point.values)
        if not rough and np.any(sudden != point.values):
            point = min(point, self.down([sudden], rough), key=lambda p: p.cost)
        return point

    def down(self, starts: Sequence[Array], rough: bool = False) -> Point:
        """Return where the way down from the best of some starts ends."""
        tried = [(start, *self.at(start)) for start in starts]
        point = self.linearise(*min(tried, key=lambda found: found[2]))
        fresh, again = True, not rough
        for _ in range((ROUGH if rough else ITERATIONS) if point.values.size else 0):
            better = self._next(point)
            if better is not None:
                point, fresh = better, False
            elif fresh or not again:
                break
            else:
                # What the corrections lack of the truth may have hidden a way down.
                point = self.linearise(point.values, point.residual, point.cost)
                fresh, again = True, False
        return point

    def _next(self, point: Point) -> Point | None:
        """Return a better point within the bounds, or None where little is to be gained."""
        low, high = self.causes.bounds
        moments = self.moments(point)
        joint = moments.weighted(self.scale)
        k, prior = point.values.size, np.concatenate([self.slab.width, moments.tolerances])
        pull = np.concatenate([moments.away / self.slab.width**2, np.zeros(len(prior) - k)])
        gradient = prior * (joint[1:, 0] + pull)
        hessian = prior[:, None] * joint[1:, 1:] * prior + np.eye(len(prior))
        for damping in DAMPINGS:
            damped = hessian.copy()
            damped[np.arange(k), np.arange(k)] *= 1.0 + damping
            trial = np.clip(point.values - (prior * np.linalg.solve(damped, gradient))[:k],
                            low, high)
            change = trial - point.values
            if self._promised(hessian, gradient, change / prior[:k]) < ENOUGH:
                return None
            residual, cost = self.at(trial)
            if cost < point.cost - 0.1 * ENOUGH:
                return self._corrected(point, trial, residual, cost)
        return None

    @staticmethod
    def _promised(hessian: Array, gradient: Array, change: Array) -> float:
        """Return what a change of the values, in widths, (k,), gains with the parts following."""
        k = change.size
        rest = np.linalg.solve(hessian[k:, k:], -(gradient[k:] + hessian[k:, :k] @ change))
        best = np.linalg.solve(hessian[k:, k:], -gradient[k:])

        def cost(step: Array) -> float:
            return float(gradient @ step + 0.5 * step @ hessian @ step)

        return cost(np.r_[np.zeros(k), best]) - cost(np.r_[change, rest])

    def _corrected(self, point: Point, trial: Array, residual: Array, cost: float) -> Point:
        """Return the point after a step, its columns such that they tell what the step did."""
        step = (trial - point.values) / self.slab.width
        missed = residual - point.residual - np.tensordot(trial - point.values, point.columns, 1)
        columns = point.columns + (
            step / (step @ step) / self.slab.width)[:, None, None] * missed
        return Point(trial, residual, columns, cost)

    def fit(self, point: Point) -> Fit:
        """Return the evidence at a point, at the scales that are likeliest there."""
        moments = self.moments(point)
        scale = moments.scaled()
        parts, covariance = moments.parts(scale).mean, moments.joined(scale).covariance
        left = -(point.residual + np.tensordot(parts, self.likelihood.columns, 1))
        weighted = left / (TEMPER * scale**2)[:, None]
        if np.any(scale > EXCESS):
            # Larger errors than any model's are no white ones: they go with the motion.
            scores = np.concatenate([by_window(rows, weighted, self.windows)
                                     for rows in (point.columns, self.likelihood.columns)])
            covariance = not_surer_than_windows(covariance, scores)
        return Fit(self.causes.hypotheses, self.likelihood.base.discrepancy, point.values, parts,
                   scale, covariance, moments, moments.log_evidence(scale),
                   self._changing(point, moments, scale),
                   -0.5 * by_window(left[None], weighted, self.windows)[0])

    @property
    def windows(self) -> int:
        """Return how many windows there are."""
        return sum(p.windows.starts.size for p in self.likelihood.predictors)

    def _changing(self, point: Point, moments: Moments, scale: Array) -> float:
        """Return what p gains where one of the causes changes over the record, nats."""
        if not (self.causes.hypotheses and self.likelihood.alike):
            return -math.inf
        pieces = self.causes.split(np.diag(moments.away))
        sizes = [np.where(h.sizes, piece, 0.0).sum(axis=1)
                 for h, piece in zip(self.causes.hypotheses, pieces)]
        rows = point.residual, point.columns, self.likelihood.columns
        return gained(moments, scale, rows, self.windows, sizes)


def fitted(likelihood: Likelihood, causes: Causes, starts: Sequence[Array],
           scale: Array | None = None, rough: bool = False) -> Fit:
    """Return causes fitted around a likelihood's linearisation, from the best of some starts."""
    scale = np.ones(len(likelihood.present)) if scale is None else scale
    descent = Descent(likelihood, causes, scale)
    return descent.fit(descent.run(starts, rough))
