"""
Evidence and estimates of an event, integrated over when it happened and how long it took.

`RefinedFit` uses it for sets with an event that may be gradual. What a record says of the event's
time has several maxima, and of its duration often an upper bound alone, so Laplace's method fails.
Given both, the residual is as linear in all else as ever. The response to a gradual change is the
mean of the responses to sudden ones over its duration, but for what is not linear in its size;
that is taken from the fitted event. So the responses to sudden events at some times give the
evidence of every start and end, see `EventGrid`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, partial
from typing import NamedTuple

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.event_grid import EventGrid
from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.gauss_newton import GaussNewton, LinearisationPoint
from flex_plant_sim.diagnosis.causes.hypothesis import BATCH_SIZE
from flex_plant_sim.diagnosis.likelihood.sufficient_statistics import TEMPER
from flex_plant_sim.diagnosis.pool import all_of
import numpy as np

# Times of sudden events whose responses are computed: at first, and at most.
FIRST_EVENT_TIMES, MAX_EVENT_TIMES = 31, 150


class EventIndices(NamedTuple):
    """Indices of an event's size, time and duration among a set's values."""

    size: int
    time: int
    duration: int


def event_indices(solver: GaussNewton) -> EventIndices | None:
    """Return the indices of the first event that may be gradual; None without one."""
    for hypothesis, first in zip(solver.causes.hypotheses, solver.causes.boundaries):
        if hypothesis.effect.event_duration:
            names = [p.name for p in hypothesis.parameters]
            return EventIndices(*(int(first + index) for index in (
                np.argmax(hypothesis.is_size), names.index(hypothesis.effect.event_time),
                names.index(hypothesis.effect.event_duration))))
    return None


class EventTimeIntegral:
    """
    The events of all times and durations in a fitted set, the residual being linear in all else.

    Parameters
    ----------
    solver : GaussNewton
        With the likelihood linearised around the set and the error scale of its fit.
    point : LinearisationPoint
        Of the fit.
    indices : EventIndices

    """

    def __init__(self, solver: GaussNewton, point: LinearisationPoint, indices: EventIndices):
        self.solver, self.point, self.indices = solver, point, indices
        self.others = np.setdiff1d(np.arange(point.values.size), indices)

    def _responses(self, times: Array, without_event: Array) -> Array:
        """Return the changes of the residual (m, N) by sudden events at times, (T, m, N)."""
        likelihood, values = self.solver.likelihood, np.repeat(
            self.point.values[None], times.size, axis=0)
        values[:, self.indices.time], values[:, self.indices.duration] = times, 0.0
        found = np.zeros((times.size, *without_event.shape))
        # An event after the last sample changes nothing.
        seen = times <= likelihood.times.max()
        if seen.any():
            batches = np.split(values[seen], np.arange(BATCH_SIZE, seen.sum(), BATCH_SIZE))
            residuals = all_of(partial(self.solver.causes.residual, likelihood), batches,
                               likelihood.jobs)
            found[seen] = np.concatenate(residuals) - without_event
        if not np.all(np.isfinite(found)):
            raise np.linalg.LinAlgError('no finite prediction')
        return found

    @cached_property
    def grid(self) -> EventGrid:
        """
        Return the grid of events, refined until the record does not tell neighbours apart.

        Raises
        ------
        LinAlgError
            Where a prediction is not finite.

        """
        indices, point, prior = self.indices, self.point, self.solver.prior
        zero_size = point.values.copy()
        zero_size[indices.size] = prior.centre[indices.size]
        without_event, _ = self.solver.residual_and_cost(zero_size)
        offsets = (point.values - prior.centre)[self.others]
        jacobian = point.jacobian[self.others]
        at_centre = without_event - np.tensordot(offsets, jacobian, 1)
        background = np.concatenate([at_centre[None], jacobian,
                                     self.solver.likelihood.part_jacobian])
        start, duration = self._event_at_point
        fitted = point.values.copy()
        fitted[[indices.time, indices.duration]] = start, duration
        response = self.solver.residual_and_cost(fitted)[0] - without_event
        record = self.solver.causes.duration
        times = np.unique(np.r_[np.linspace(0.0, record, FIRST_EVENT_TIMES),
                                start, start + duration])
        grid = EventGrid(
            times, self._responses(times, without_event), background,
            np.r_[prior.width[self.others], self.solver.likelihood.tolerances],
            float(prior.width[indices.size]), prior.widths[:, indices.duration],
            float(point.values[indices.size] - prior.centre[indices.size]),
            0.5 if prior.spiked[indices.duration] else 0.0,
            1.0 / (TEMPER * self.solver.error_scale**2),
            float(np.min(np.diff(np.unique(self.solver.likelihood.times)))))
        exact = partial(_exact_at, start=start, duration=duration, response=response)
        while grid.time.size < MAX_EVENT_TIMES and (more := exact(grid).refinement_times).size:
            times = np.r_[grid.time, more]
            order = np.argsort(times)
            responses = np.concatenate([grid.responses, self._responses(more, without_event)])
            grid = replace(grid, time=times[order], responses=responses[order])
        return exact(grid)

    @property
    def _event_at_point(self) -> tuple[float, float]:
        """Return start and duration of the point's event, s, clipped to the record."""
        start, duration = self.point.values[[self.indices.time, self.indices.duration]]
        start = min(start, self.solver.causes.duration)
        return start, min(duration, self.solver.causes.duration - start)

    def integrated(self) -> tuple[LinearisationPoint, Fit, float]:
        """
        Return the estimated event, its fit, and the gain over the point's event, nats.

        The fit's evidence and covariance are integrated over all times and durations.

        Raises
        ------
        LinAlgError
            Where a prediction is not finite.

        """
        grid, indices, k = self.grid, self.indices, self.point.values.size
        estimate = grid.estimate()
        order = np.r_[indices.time, indices.duration, indices.size, self.others]
        values = np.empty(k)
        values[order] = estimate[:k]
        values[order[2:]] += self.solver.prior.centre[order[2:]]
        values = np.clip(values, *self.solver.causes.bounds)
        point = self.solver.linearise(values, *self.solver.residual_and_cost(values))
        point = self.solver.exact_at(point, values, self.solver.fit(point).deviations)
        fit = self.solver.fit(point)
        given_time = fit.statistics.held_fixed((indices.time, indices.duration))
        here, there = (float(grid.log_likelihood_of(grid.averaging_weights_of(start, duration)))
                       for start, duration in (self._event_at_point, estimate[:2]))
        offsets = np.r_[values[order[:2]], fit.statistics.offsets[order[2:]], fit.deviations]
        covariance, order = np.empty_like(fit.covariance), np.r_[
            order, k:k + fit.deviations.size]
        covariance[np.ix_(order, order)] = grid.mean_square_deviation(offsets)
        # The factor of the sandwich covariance, where windows disagree.
        wider = np.sqrt(np.diagonal(fit.covariance)
                        / np.diagonal(fit.statistics.joint_marginal(fit.error_scale).covariance))
        log_evidence = given_time.log_evidence(fit.error_scale) + grid.log_integral - there
        return point, replace(fit, covariance=wider[:, None] * covariance * wider,
                              log_evidence=log_evidence), there - here


def _exact_at(grid: EventGrid, start: float, duration: float, response: Array) -> EventGrid:
    """Return a grid that has an event's response (m, N) where it says the mean of sudden ones."""
    # A change of 40 % over 5 s shifts modes: the means alone had 10 nats more for one of 3.5 s.
    mean = np.tensordot(grid.averaging_weights_of(start, duration), grid.responses, 1)
    background = grid.background.copy()
    background[0] += response - mean
    return replace(grid, background=background)
