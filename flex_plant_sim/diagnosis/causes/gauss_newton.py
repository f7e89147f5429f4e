"""
Maximum a posteriori fit of a set of causes by Gauss-Newton, with the parts integrated out.

It works on one `Likelihood`. `RefinedFit` and `NeighbourFitter` choose where that is linearised.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.hypothesis import CauseSet
from flex_plant_sim.diagnosis.likelihood.constancy import (
    PartConstancy,
    varying_cause_gain,
    window_sums,
)
from flex_plant_sim.diagnosis.likelihood.evidence import (
    channel_products,
    GaussianMarginal,
    sandwich_covariance,
)
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.sufficient_statistics import SufficientStatistics, TEMPER
import numpy as np

# Steps of a fit at most; a budget. (After three, a payload beyond the tip was 71 nats behind a
# soft gear that stands for it; after eight it is 14 ahead.)
MAX_STEPS = 8
# Predicted gain of a step, nats, below which a fit ends.
MIN_STEP_GAIN = 0.3
# Levenberg-Marquardt damping, as factors on the diagonal, tried in turn until the cost falls.
DAMPING_FACTORS = (1e-4, 0.1, 10.0)
# Shortest step of a difference, as a share of the value: half of the digits are then of the slope.
LEAST_STEP = math.sqrt(np.finfo(float).eps)


@dataclass(frozen=True)
class LinearisationPoint:
    """
    The residual linearised in the values of some causes.

    Attributes
    ----------
    values : Array
        (k,).
    residual : Array
        r at the values, (m, N); see `Likelihood`.
    jacobian : Array
        Derivatives of r in the values, (k, m, N).
    cost : float
        Minus the log-posterior at the values, nats, up to a constant.

    """

    values: Array
    residual: Array
    jacobian: Array
    cost: float


class GaussNewton:
    """
    Damped Gauss-Newton over the values of some causes, with the parts integrated out.

    The Jacobian is taken by differences at the start and where a step fails. In between, Broyden's
    update corrects it by what each step shows (C. G. Broyden, Mathematics of Computation 19
    (1965)), so that a step costs one pass through the record.

    Parameters
    ----------
    likelihood : Likelihood
    causes : CauseSet
    error_scale : Array
        Factor of the errors over what the filter states, (m,).

    """

    def __init__(self, likelihood: Likelihood, causes: CauseSet, error_scale: Array):
        self.likelihood, self.causes, self.prior = likelihood, causes, causes.prior
        self.error_scale = error_scale

    def _products(self, rows: Array) -> Array:
        """Return the products of rows (a, m, N) and the parts' Jacobian, (m, a + p, a + p)."""
        cross = channel_products(rows, self.likelihood.part_jacobian)
        return np.block([[channel_products(rows, rows), cross],
                         [cross.transpose(0, 2, 1), self.likelihood.part_products]])

    def statistics(self, point: LinearisationPoint) -> SufficientStatistics:
        """Return the sufficient statistics at a point."""
        rows = np.concatenate([point.residual[None], point.jacobian])
        return SufficientStatistics(
            self._products(rows), point.values - self.prior.centre, self.prior,
            self.likelihood.tolerances, self.likelihood.weight * point.residual.shape[1],
            self.likelihood.channel_log_determinants)

    def cost(self, values: Array, residual: Array) -> float:
        """Return minus the log-posterior, nats; infinite where the residual is not finite."""
        if not np.all(np.isfinite(residual)):
            return float('inf')
        products = np.tensordot(1.0 / (TEMPER * self.error_scale**2),
                                self._products(residual[None]), 1)
        marginal = GaussianMarginal(products, self.likelihood.tolerances)
        return 0.5 * marginal.quadratic + self.prior.cost(values - self.prior.centre)

    def residual_and_cost(self, values: Array) -> tuple[Array, float]:
        """Return residual (m, N) and cost at values, (k,)."""
        residual = self.causes.residual(self.likelihood, values[None])[0]
        return residual, self.cost(values, residual)

    def exact_at(self, point: LinearisationPoint, values: Array, deviations: Array
                 ) -> LinearisationPoint:
        """Return a point moved to other values, its residual exact at parts' deviations, (p,)."""
        exact = self.likelihood.whitened_residual(self.causes.effects(values), deviations)[0]
        residual = exact - np.tensordot(deviations, self.likelihood.part_jacobian, 1)
        return LinearisationPoint(values, residual, point.jacobian, self.cost(values, residual))

    def linearise(self, values: Array, residual: Array, cost: float) -> LinearisationPoint:
        """
        Return the point at values with its Jacobian by differences.

        A step that ends where the arm is unstable is replaced by the shortest.

        Raises
        ------
        LinAlgError
            Where the prediction is not finite.

        """
        jacobian = np.zeros((values.size, *residual.shape))
        step = self.causes.difference_steps(values)
        point = self._differenced(LinearisationPoint(values, residual, jacobian, cost), step,
                                  self._free)
        unstable = np.array([not np.isfinite(_power(rows)) for rows in point.jacobian], dtype=bool)
        point = self._differenced(point, np.copysign(self._least_step(values), step), unstable)
        if not (np.isfinite(cost) and np.isfinite(_power(point.jacobian))):
            raise np.linalg.LinAlgError('no finite prediction')
        return point

    def within_deviations(self, point: LinearisationPoint) -> LinearisationPoint:
        """
        Return a point with no row of its Jacobian from a difference beyond a standard deviation.

        Within that, Laplace's method asks for the slope. The usual step from a value that is known
        well may end where nothing is linear, or nothing stable; so it is taken over a shorter one.
        """
        step, k = self.causes.difference_steps(point.values), point.values.size
        marginal = self.statistics(point).joint_marginal(self.error_scale)
        deviation = np.maximum(np.sqrt(np.diagonal(marginal.covariance)[:k]),
                               self._least_step(point.values))
        too_long = np.logical_and(self._free, np.abs(step) > deviation)
        return self._differenced(point, np.copysign(deviation, step), too_long)

    def _least_step(self, values: Array) -> Array:
        """Return the shortest step of a difference, (k,)."""
        return LEAST_STEP * np.maximum(np.abs(values), self.prior.width)

    @property
    def _free(self) -> Array:
        """Return whether each value is free, (k,); some are fixed."""
        low, high = self.causes.bounds
        return np.asarray(low < high)

    def _differenced(self, point: LinearisationPoint, step: Array, which: Array
                     ) -> LinearisationPoint:
        """Return a point with some rows of its Jacobian by differences over steps, (k,) each."""
        if not which.any():
            return point
        moved = self.causes.residual(self.likelihood, (point.values + np.diag(step))[which])
        jacobian = point.jacobian.copy()
        jacobian[which] = (moved - point.residual) / step[which, None, None]
        return replace(point, jacobian=jacobian)

    def descend(self, starts: Sequence[Array], coarse: bool = False) -> LinearisationPoint:
        """Return where Gauss-Newton steps from the best of some starts end."""
        residuals = self.causes.residual(self.likelihood, np.array(starts))
        tried = [(start, residual, self.cost(start, residual))
                 for start, residual in zip(starts, residuals)]
        point = self.linearise(*min(tried, key=lambda found: found[2]))
        exact_jacobian, may_retry, may_shorten = True, not coarse, not coarse
        for _ in range(MAX_STEPS if point.values.size else 0):
            better = self._next_point(point)
            if better is not None:
                point, exact_jacobian = better, False
            elif may_retry and not exact_jacobian:
                # Errors of Broyden's updates may hide a step down.
                point = self.linearise(point.values, point.residual, point.cost)
                exact_jacobian, may_retry = True, False
            elif may_shorten:
                point, exact_jacobian, may_shorten = self.within_deviations(point), True, False
            else:
                break
        return self.within_deviations(point) if may_shorten else point

    def _next_point(self, point: LinearisationPoint) -> LinearisationPoint | None:
        """Return a better point within the bounds, or None where little can be gained."""
        low, high = self.causes.bounds
        statistics = self.statistics(point)
        products = statistics.weighted_products(self.error_scale)
        k, widths = point.values.size, np.concatenate([statistics.widths, statistics.tolerances])
        # In units of the prior widths, for values and parts together.
        pull = np.concatenate([statistics.offsets / statistics.widths**2,
                               np.zeros(len(widths) - k)])
        gradient = widths * (products[1:, 0] + pull)
        hessian = widths[:, None] * products[1:, 1:] * widths + np.eye(len(widths))
        for damping in DAMPING_FACTORS:
            damped = hessian.copy()
            damped[np.arange(k), np.arange(k)] *= 1.0 + damping
            trial = np.clip(point.values - (widths * np.linalg.solve(damped, gradient))[:k],
                            low, high)
            change = trial - point.values
            if self._predicted_gain(hessian, gradient, change / widths[:k]) < MIN_STEP_GAIN:
                return None
            residual, cost = self.residual_and_cost(trial)
            if cost < point.cost - 0.1 * MIN_STEP_GAIN:
                return self._broyden_update(point, trial, residual, cost)
        return None

    @staticmethod
    def _predicted_gain(hessian: Array, gradient: Array, change: Array) -> float:
        """Return the predicted gain of a step in the values, in widths, (k,), parts at optimum."""
        k = change.size
        after = np.linalg.solve(hessian[k:, k:], -(gradient[k:] + hessian[k:, :k] @ change))
        before = np.linalg.solve(hessian[k:, k:], -gradient[k:])

        def cost(step: Array) -> float:
            return float(gradient @ step + 0.5 * step @ hessian @ step)

        return cost(np.r_[np.zeros(k), before]) - cost(np.r_[change, after])

    def _broyden_update(self, point: LinearisationPoint, trial: Array, residual: Array,
                        cost: float) -> LinearisationPoint:
        """Return the point after a step, with the Jacobian that explains the step."""
        step = (trial - point.values) / self.prior.width
        unexplained = residual - point.residual - np.tensordot(
            trial - point.values, point.jacobian, 1)
        jacobian = point.jacobian + (
            step / (step @ step) / self.prior.width)[:, None, None] * unexplained
        return LinearisationPoint(trial, residual, jacobian, cost)

    def fit(self, point: LinearisationPoint) -> Fit:
        """Return the fit at a point, with the likeliest error scales there."""
        statistics = self.statistics(point)
        error_scale = statistics.likeliest_error_scale()
        deviations = statistics.part_marginal(error_scale).mean
        covariance = statistics.joint_marginal(error_scale).covariance
        minus_errors = -(point.residual
                         + np.tensordot(deviations, self.likelihood.part_jacobian, 1))
        weighted = minus_errors / (TEMPER * error_scale**2)[:, None]
        found = Fit(self.causes.hypotheses, self.likelihood.base.discrepancy, point.values,
                    deviations, error_scale, covariance, statistics,
                    statistics.log_evidence(error_scale),
                    self._varying_gain(point, statistics, error_scale),
                    -0.5 * window_sums(minus_errors[None], weighted, self.window_count)[0],
                    *self._slow_errors(minus_errors),
                    self._varying_part_gains(point, statistics, error_scale))
        if not found.large_errors.any():
            return found
        # Errors that are larger than any model's go with the motion and are not white.
        scores = np.concatenate([window_sums(rows, weighted, self.window_count)
                                 for rows in (point.jacobian, self.likelihood.part_jacobian)])
        return replace(found, covariance=sandwich_covariance(covariance, scores))

    def _slow_errors(self, errors: Array) -> tuple[Array, Array]:
        """
        Return scales and number of means of errors (m, N) over their correlation times, (m,) each.

        Those are the times of what every model misses, of a joint's torque and of a strain.
        """
        likelihood = self.likelihood
        by_channel = errors.reshape(len(errors), self.window_count, -1)
        model, period = likelihood.base.discrepancy, likelihood.predictors[0].windows.warm_up
        found = [slow_means(of_one, max(1, round(periods * period)))
                 for of_one, periods in zip(by_channel, [model.torque_periods] * 2
                                            + [model.gauge_periods] * (len(errors) - 2))]
        # Each sample of some windows stands for more, and errors are larger by the root of that.
        return (np.array([np.sqrt(np.mean(means**2) / likelihood.weight) for means in found]),
                np.array([round(likelihood.weight * means.size) for means in found]))

    @property
    def window_count(self) -> int:
        """Return the number of windows of all records."""
        return sum(p.windows.starts.size for p in self.likelihood.predictors)

    def _varying_part_gains(self, point: LinearisationPoint, statistics: SufficientStatistics,
                            error_scale: Array) -> Array:
        """Return the gains of the evidence if a part varies, nats, (p,); none where none may."""
        if not self.likelihood.shared_covariance:
            return np.zeros(0)
        return part_constancy(self.likelihood, point, statistics, error_scale).gains

    def _varying_gain(self, point: LinearisationPoint, statistics: SufficientStatistics,
                      error_scale: Array) -> float:
        """Return the gain of the evidence if a cause varies, nats; -inf where none may."""
        if not (self.causes.hypotheses and self.likelihood.shared_covariance):
            return -math.inf
        offsets = self.causes.split(np.diag(statistics.offsets))
        sizes = [np.where(h.is_size, of_cause, 0.0).sum(axis=1)
                 for h, of_cause in zip(self.causes.hypotheses, offsets)]
        rows = point.residual, point.jacobian, self.likelihood.part_jacobian
        return varying_cause_gain(statistics, error_scale, rows, self.window_count, sizes)


def part_constancy(likelihood: Likelihood, point: LinearisationPoint,
                   statistics: SufficientStatistics, error_scale: Array) -> PartConstancy:
    """Return how the parts may vary over the record beside the causes of a point."""
    rows = point.residual, point.jacobian, likelihood.part_jacobian
    return PartConstancy(statistics, error_scale, rows, likelihood.part_products_by_window)


def _power(rows: Array) -> float:
    """Return the sum of squares; a diverging prediction may be finite, its power is not."""
    with np.errstate(over='ignore'):
        return float(np.sum(rows**2))


def fit_set(likelihood: Likelihood, causes: CauseSet, starts: Sequence[Array],
            error_scale: Array | None = None, coarse: bool = False) -> Fit:
    """Return the fit of a set on one likelihood, from the best of some starts."""
    error_scale = np.ones(len(likelihood.centre_residual)) if error_scale is None else error_scale
    solver = GaussNewton(likelihood, causes, error_scale)
    return solver.fit(solver.descend(starts, coarse))


def slow_means(errors: Array, length: int) -> Array:
    """Return means of errors (W, N) over `length` samples, times its root, (W, c)."""
    count = errors.shape[1] // length
    return errors[:, :count * length].reshape(len(errors), count, length).sum(axis=2) / length**0.5
