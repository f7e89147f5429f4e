"""Fit a set of causes with the parts of the arm: its values, its evidence, how sure it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
import math

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.hypothesis import CauseSet, Hypothesis
from flex_plant_sim.diagnosis.likelihood.constancy import varying_cause_gain, window_sums
from flex_plant_sim.diagnosis.likelihood.evidence import (
    channel_products,
    GaussianMarginal,
    sandwich_covariance,
)
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.prior import FAR_PART_FACTOR
from flex_plant_sim.diagnosis.likelihood.sufficient_statistics import SufficientStatistics, TEMPER
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
import numpy as np

# Steps at most, of a fit and of one that only ranks.
MAX_STEPS, MAX_COARSE_STEPS = 8, 3
# A step that promises less is not worth a pass, nats.
MIN_STEP_GAIN = 0.3
# Errors that exceed what is stated by less leave nothing to explain.
NOTABLE_EXCESS = 1.05
# Of Levenberg and Marquardt, tried until the cost falls.
DAMPING_FACTORS = (1e-4, 0.1, 10.0)


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
    window_log_likelihoods : Array
        ln p of each window at the values and the parts, but for what is the same in all, (W,).

    """

    hypotheses: tuple[Hypothesis, ...]
    discrepancy: DiscrepancyModel
    values: Array
    deviations: Array
    error_scale: Array
    covariance: Array
    statistics: SufficientStatistics
    log_evidence: float
    varying_gain: float = -math.inf
    window_log_likelihoods: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class LinearisationPoint:
    """A linearisation: values (k,), residual (m, N), its columns (k, m, N), the cost in nats."""

    values: Array
    residual: Array
    jacobian: Array
    cost: float


def with_far_part(fit: Fit, name: str, place: int) -> Fit:
    """Return a fit as it is judged with one part that is not as its file says."""
    tolerances = fit.statistics.tolerances.copy()
    tolerances[place] *= FAR_PART_FACTOR
    statistics = replace(fit.statistics, tolerances=tolerances)
    error_scale = statistics.likeliest_error_scale()
    return replace(fit, discrepancy=replace(fit.discrepancy, far_part=name), error_scale=error_scale,
                   deviations=statistics.part_marginal(error_scale).mean, statistics=statistics,
                   covariance=statistics.joint_marginal(error_scale).covariance,
                   log_evidence=statistics.log_evidence(error_scale))


class GaussNewton:
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

    def __init__(self, likelihood: Likelihood, causes: CauseSet, error_scale: Array):
        self.likelihood, self.causes, self.prior = likelihood, causes, causes.prior
        self.error_scale = error_scale

    def _products(self, own: Array) -> Array:
        """Return products of own rows (a, m, N) and the parts' columns, (m, a + p, a + p)."""
        cross = channel_products(own, self.likelihood.part_jacobian)
        return np.block([[channel_products(own, own), cross],
                         [cross.transpose(0, 2, 1), self.likelihood.part_products]])

    def statistics(self, point: LinearisationPoint) -> SufficientStatistics:
        """Return the products at a point."""
        own = np.concatenate([point.residual[None], point.jacobian])
        return SufficientStatistics(self._products(own), point.values - self.prior.centre, self.prior,
                       self.likelihood.tolerances,
                       self.likelihood.weight * point.residual.shape[1],
                       self.likelihood.channel_log_determinants)

    def cost(self, values: Array, residual: Array) -> float:
        """Return minus the log-posterior at values, nats; infinite where nothing is predicted."""
        if not np.all(np.isfinite(residual)):
            return float('inf')
        products = np.tensordot(1.0 / (TEMPER * self.error_scale**2),
                                self._products(residual[None]), 1)
        offsets = (values - self.prior.centre) / self.prior.width
        return 0.5 * (GaussianMarginal(products, self.likelihood.tolerances).quadratic
                      + float(offsets @ offsets))

    def residual_and_cost(self, values: Array) -> tuple[Array, float]:
        """Return residual (m, N) and cost at values, (k,)."""
        residual = self.causes.residual(self.likelihood, values[None])[0]
        return residual, self.cost(values, residual)

    def exact_at(self, point: LinearisationPoint, values: Array, deviations: Array) -> LinearisationPoint:
        """Return a point's columns at other values, exact there with deviations, (p,)."""
        exact = self.likelihood.whitened_residual(self.causes.effects(values), deviations)[0]
        residual = exact - np.tensordot(deviations, self.likelihood.part_jacobian, 1)
        return LinearisationPoint(values, residual, point.jacobian, self.cost(values, residual))

    def linearise(self, values: Array, residual: Array, cost: float) -> LinearisationPoint:
        """
        Return the columns at values by differences.

        Raises
        ------
        LinAlgError
            Where the prediction is not finite.

        """
        columns = np.zeros((0, *residual.shape))
        if values.size:
            step = self.causes.difference_steps(values)
            moved = self.causes.residual(self.likelihood, values + np.diag(step))
            columns = (moved - residual) / step[:, None, None]
        with np.errstate(over='ignore'):
            # What diverges may be finite at the last sample, and yet its products are not.
            power = float(np.sum(columns**2))
        if not (np.isfinite(cost) and np.isfinite(power)):
            raise np.linalg.LinAlgError('no finite prediction')
        return LinearisationPoint(values, residual, columns, cost)

    def minimise(self, starts: Sequence[Array], coarse: bool = False) -> LinearisationPoint:
        """
        Return the minimum found from the best of some starts, linearised near it.

        What takes its time is tried from all of it at once, too: between are side valleys.
        """
        point = self.descend(starts, coarse)
        sudden = self.causes.as_sudden(point.values)
        if not coarse and np.any(sudden != point.values):
            point = min(point, self.descend([sudden], coarse), key=lambda p: p.cost)
        return point

    def descend(self, starts: Sequence[Array], coarse: bool = False) -> LinearisationPoint:
        """Return where the way down from the best of some starts ends."""
        tried = [(start, *self.residual_and_cost(start)) for start in starts]
        point = self.linearise(*min(tried, key=lambda found: found[2]))
        fresh, may_retry = True, not coarse
        for _ in range((MAX_COARSE_STEPS if coarse else MAX_STEPS) if point.values.size else 0):
            better = self._next_point(point)
            if better is not None:
                point, fresh = better, False
            elif fresh or not may_retry:
                break
            else:
                # What the corrections lack of the truth may have hidden a way down.
                point = self.linearise(point.values, point.residual, point.cost)
                fresh, may_retry = True, False
        return point

    def _next_point(self, point: LinearisationPoint) -> LinearisationPoint | None:
        """Return a better point within the bounds, or None where little is to be gained."""
        low, high = self.causes.bounds
        statistics = self.statistics(point)
        joint = statistics.weighted_products(self.error_scale)
        k, prior = point.values.size, np.concatenate([self.prior.width, statistics.tolerances])
        pull = np.concatenate([statistics.offsets / self.prior.width**2, np.zeros(len(prior) - k)])
        gradient = prior * (joint[1:, 0] + pull)
        hessian = prior[:, None] * joint[1:, 1:] * prior + np.eye(len(prior))
        for damping in DAMPING_FACTORS:
            damped = hessian.copy()
            damped[np.arange(k), np.arange(k)] *= 1.0 + damping
            trial = np.clip(point.values - (prior * np.linalg.solve(damped, gradient))[:k],
                            low, high)
            change = trial - point.values
            if self._predicted_gain(hessian, gradient, change / prior[:k]) < MIN_STEP_GAIN:
                return None
            residual, cost = self.residual_and_cost(trial)
            if cost < point.cost - 0.1 * MIN_STEP_GAIN:
                return self._broyden_update(point, trial, residual, cost)
        return None

    @staticmethod
    def _predicted_gain(hessian: Array, gradient: Array, change: Array) -> float:
        """Return what a change of the values, in widths, (k,), gains with the parts following."""
        k = change.size
        rest = np.linalg.solve(hessian[k:, k:], -(gradient[k:] + hessian[k:, :k] @ change))
        best = np.linalg.solve(hessian[k:, k:], -gradient[k:])

        def cost(step: Array) -> float:
            return float(gradient @ step + 0.5 * step @ hessian @ step)

        return cost(np.r_[np.zeros(k), best]) - cost(np.r_[change, rest])

    def _broyden_update(self, point: LinearisationPoint, trial: Array, residual: Array, cost: float) -> LinearisationPoint:
        """Return the point after a step, its columns such that they tell what the step did."""
        step = (trial - point.values) / self.prior.width
        missed = residual - point.residual - np.tensordot(trial - point.values, point.jacobian, 1)
        columns = point.jacobian + (
            step / (step @ step) / self.prior.width)[:, None, None] * missed
        return LinearisationPoint(trial, residual, columns, cost)

    def fit(self, point: LinearisationPoint) -> Fit:
        """Return the evidence at a point, at the scales that are likeliest there."""
        statistics = self.statistics(point)
        error_scale = statistics.likeliest_error_scale()
        parts, covariance = statistics.part_marginal(error_scale).mean, statistics.joint_marginal(error_scale).covariance
        left = -(point.residual + np.tensordot(parts, self.likelihood.part_jacobian, 1))
        weighted = left / (TEMPER * error_scale**2)[:, None]
        if np.any(error_scale > NOTABLE_EXCESS):
            # Larger errors than any model's are no white ones: they go with the motion.
            scores = np.concatenate([window_sums(rows, weighted, self.window_count)
                                     for rows in (point.jacobian, self.likelihood.part_jacobian)])
            covariance = sandwich_covariance(covariance, scores)
        return Fit(self.causes.hypotheses, self.likelihood.base.discrepancy, point.values, parts,
                   error_scale, covariance, statistics, statistics.log_evidence(error_scale),
                   self._varying_gain(point, statistics, error_scale),
                   -0.5 * window_sums(left[None], weighted, self.window_count)[0])

    @property
    def window_count(self) -> int:
        """Return how many windows there are."""
        return sum(p.windows.starts.size for p in self.likelihood.predictors)

    def _varying_gain(self, point: LinearisationPoint, statistics: SufficientStatistics, error_scale: Array) -> float:
        """Return what p gains where one of the causes changes over the record, nats."""
        if not (self.causes.hypotheses and self.likelihood.shared_covariance):
            return -math.inf
        pieces = self.causes.split(np.diag(statistics.offsets))
        sizes = [np.where(h.is_size, piece, 0.0).sum(axis=1)
                 for h, piece in zip(self.causes.hypotheses, pieces)]
        rows = point.residual, point.jacobian, self.likelihood.part_jacobian
        return varying_cause_gain(statistics, error_scale, rows, self.window_count, sizes)


def fit_set(likelihood: Likelihood, causes: CauseSet, starts: Sequence[Array],
           error_scale: Array | None = None, coarse: bool = False) -> Fit:
    """Return causes fitted around a likelihood's linearisation, from the best of some starts."""
    error_scale = np.ones(len(likelihood.centre_residual)) if error_scale is None else error_scale
    descent = GaussNewton(likelihood, causes, error_scale)
    return descent.fit(descent.minimise(starts, coarse))
