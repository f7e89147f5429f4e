"""
When an event happened and how long it took: integrated over, for no parabola tells them.

What a record says of an event's time has side valleys, and of its duration often no more than an
upper bound: a change over 3 s and a sudden one in its middle may be as likely. Given both, all
else is as linear as ever. And the response to a slow change is the mean of those to sudden ones
over its duration, as it is linear in what has happened by then; so the responses to sudden ones
at some times tell the evidence of every pair of a start and an end.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, partial
from typing import NamedTuple

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.event_grid import EventGrid
from flex_plant_sim.diagnosis.causes.fit import Fit, GaussNewton, LinearisationPoint
from flex_plant_sim.diagnosis.causes.hypothesis import BATCH_SIZE, EVENT_GRID_TIMES
from flex_plant_sim.diagnosis.likelihood.sufficient_statistics import TEMPER
from flex_plant_sim.diagnosis.pool import all_of
import numpy as np

# Times at most.
MAX_EVENT_TIMES = 150


class EventIndices(NamedTuple):
    """Where an event's size, time and duration are among a set's values."""

    size: int
    time: int
    duration: int


def event_indices(descent: GaussNewton) -> EventIndices | None:
    """Return where the first event's values are that may take its time; None without one."""
    for hypothesis, first in zip(descent.causes.hypotheses, descent.causes.boundaries):
        if hypothesis.effect.event_duration:
            names = [p.name for p in hypothesis.parameters]
            return EventIndices(*(int(first + indices) for indices in (
                np.argmax(hypothesis.is_size), names.index(hypothesis.effect.event_time),
                names.index(hypothesis.effect.event_duration))))
    return None


class EventTimeIntegral:
    """
    The events of a set that was fitted, of any time and duration, all else being as linear.

    Parameters
    ----------
    descent : Descent
        Its likelihood is linearised around the set, its scale is the fit's.
    point : Point
    places : Places

    """

    def __init__(self, descent: GaussNewton, point: LinearisationPoint, indices: EventIndices):
        self.descent, self.point, self.indices = descent, point, indices
        self.others = np.setdiff1d(np.arange(point.values.size), indices)

    def _responses(self, times: Array, nothing: Array) -> Array:
        """Return what sudden events add to the residual without one, (T, m, N)."""
        likelihood, values = self.descent.likelihood, np.repeat(
            self.point.values[None], times.size, axis=0)
        values[:, self.indices.time], values[:, self.indices.duration] = times, 0.0
        found = np.zeros((times.size, *nothing.shape))
        # After the last sample there is nothing left to change.
        seen = times <= likelihood.times.max()
        if seen.any():
            pieces = np.split(values[seen], np.arange(BATCH_SIZE, seen.sum(), BATCH_SIZE))
            more = all_of(partial(self.descent.causes.residual, likelihood), pieces,
                          likelihood.jobs)
            found[seen] = np.concatenate(more) - nothing
        if not np.all(np.isfinite(found)):
            raise np.linalg.LinAlgError('no finite prediction')
        return found

    @cached_property
    def grid(self) -> EventGrid:
        """
        Return events of all times, as many as the record tells apart.

        Raises
        ------
        LinAlgError
            Where a prediction is not finite.

        """
        indices, point, prior = self.indices, self.point, self.descent.prior
        zero_size = point.values.copy()
        zero_size[indices.size] = prior.centre[indices.size]
        nothing, _ = self.descent.residual_and_cost(zero_size)
        offsets = (point.values - prior.centre)[self.others]
        columns = point.jacobian[self.others]
        background = np.concatenate([(nothing - np.tensordot(offsets, columns, 1))[None], columns,
                               self.descent.likelihood.part_jacobian])
        start, duration = self._event_at_point
        times = np.unique(np.r_[np.linspace(0.0, self.descent.causes.duration, EVENT_GRID_TIMES + 1),
                                start, start + duration])
        grid = EventGrid(
            times, self._responses(times, nothing), background,
            np.r_[prior.width[self.others], self.descent.likelihood.tolerances],
            (float(prior.width[indices.size]), float(prior.width[indices.duration])),
            float(point.values[indices.size] - prior.centre[indices.size]),
            0.5 if prior.spiked[indices.duration] else 0.0, 1.0 / (TEMPER * self.descent.error_scale**2))
        while grid.time.size < MAX_EVENT_TIMES and (more := grid.refinement_times).size:
            times = np.r_[grid.time, more]
            order = np.argsort(times)
            responses = np.concatenate([grid.responses, self._responses(more, nothing)])
            grid = replace(grid, time=times[order], responses=responses[order])
        return grid

    @property
    def _event_at_point(self) -> tuple[float, float]:
        """Return start and duration of the event at the point, s, within the record."""
        start, duration = self.point.values[[self.indices.time, self.indices.duration]]
        start = min(start, self.descent.causes.duration)
        return start, min(duration, self.descent.causes.duration - start)

    def integrated(self) -> tuple[LinearisationPoint, Fit, float]:
        """
        Return the likeliest event, its fit, and what it gains over the one at the point, nats.

        The fit's evidence and its spread are those over all times and durations.

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
        values[order[2:]] += self.descent.prior.centre[order[2:]]
        values = np.clip(values, *self.descent.causes.bounds)
        point = self.descent.linearise(values, *self.descent.residual_and_cost(values))
        point = self.descent.exact_at(point, values, self.descent.fit(point).deviations)
        fit = self.descent.fit(point)
        held = fit.statistics.held_fixed((indices.time, indices.duration))
        here, there = (float(grid.log_likelihood_of(grid.averaging_weights_of(start, duration)))
                       for start, duration in (self._event_at_point, estimate[:2]))
        offsets = np.r_[values[order[:2]], fit.statistics.offsets[order[2:]], fit.deviations]
        covariance, order = np.empty_like(fit.covariance), np.r_[
            order, k:k + fit.deviations.size]
        covariance[np.ix_(order, order)] = grid.mean_square_deviation(offsets)
        # Where windows disagree, as much wider as without.
        wider = np.sqrt(np.diagonal(fit.covariance)
                        / np.diagonal(fit.statistics.joint_marginal(fit.error_scale).covariance))
        return point, replace(
            fit, covariance=wider[:, None] * covariance * wider,
            log_evidence=held.log_evidence(fit.error_scale) + grid.log_integral - there), there - here
