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
from flex_plant_sim.diagnosis.causes.fit import Descent, Fit, Point
from flex_plant_sim.diagnosis.causes.hypothesis import BATCH, TIMES
from flex_plant_sim.diagnosis.causes.ramps import Ramps
from flex_plant_sim.diagnosis.likelihood.moments import TEMPER
from flex_plant_sim.diagnosis.pool import all_of
import numpy as np

# Times at most.
MOST = 150


class Places(NamedTuple):
    """Where an event's size, time and duration are among a set's values."""

    size: int
    time: int
    duration: int


def places_of_event(descent: Descent) -> Places | None:
    """Return where the first event's values are that may take its time; None without one."""
    for hypothesis, first in zip(descent.causes.hypotheses, descent.causes.ends):
        if hypothesis.effect.event_duration:
            names = [p.name for p in hypothesis.parameters]
            return Places(*(int(first + place) for place in (
                np.argmax(hypothesis.sizes), names.index(hypothesis.effect.event_time),
                names.index(hypothesis.effect.event_duration))))
    return None


class Events:
    """
    The events of a set that was fitted, of any time and duration, all else being as linear.

    Parameters
    ----------
    descent : Descent
        Its likelihood is linearised around the set, its scale is the fit's.
    point : Point
    places : Places

    """

    def __init__(self, descent: Descent, point: Point, places: Places):
        self.descent, self.point, self.places = descent, point, places
        self.others = np.setdiff1d(np.arange(point.values.size), places)

    def _responses(self, times: Array, nothing: Array) -> Array:
        """Return what sudden events add to the residual without one, (T, m, N)."""
        likelihood, values = self.descent.likelihood, np.repeat(
            self.point.values[None], times.size, axis=0)
        values[:, self.places.time], values[:, self.places.duration] = times, 0.0
        found = np.zeros((times.size, *nothing.shape))
        # After the last sample there is nothing left to change.
        seen = times <= likelihood.times.max()
        if seen.any():
            pieces = np.split(values[seen], np.arange(BATCH, seen.sum(), BATCH))
            more = all_of(partial(self.descent.causes.residual, likelihood), pieces,
                          likelihood.jobs)
            found[seen] = np.concatenate(more) - nothing
        if not np.all(np.isfinite(found)):
            raise np.linalg.LinAlgError('no finite prediction')
        return found

    @cached_property
    def ramps(self) -> Ramps:
        """
        Return events of all times, as many as the record tells apart.

        Raises
        ------
        LinAlgError
            Where a prediction is not finite.

        """
        place, point, slab = self.places, self.point, self.descent.slab
        without = point.values.copy()
        without[place.size] = slab.centre[place.size]
        nothing, _ = self.descent.at(without)
        away = (point.values - slab.centre)[self.others]
        columns = point.columns[self.others]
        rest = np.concatenate([(nothing - np.tensordot(away, columns, 1))[None], columns,
                               self.descent.likelihood.columns])
        start, duration = self._own
        times = np.unique(np.r_[np.linspace(0.0, self.descent.causes.duration, TIMES + 1),
                                start, start + duration])
        ramps = Ramps(
            times, self._responses(times, nothing), rest,
            np.r_[slab.width[self.others], self.descent.likelihood.tolerances],
            (float(slab.width[place.size]), float(slab.width[place.duration])),
            float(point.values[place.size] - slab.centre[place.size]),
            0.5 if slab.spiked[place.duration] else 0.0, 1.0 / (TEMPER * self.descent.scale**2))
        while ramps.time.size < MOST and (more := ramps.between).size:
            times = np.r_[ramps.time, more]
            order = np.argsort(times)
            rows = np.concatenate([ramps.rows, self._responses(more, nothing)])
            ramps = replace(ramps, time=times[order], rows=rows[order])
        return ramps

    @property
    def _own(self) -> tuple[float, float]:
        """Return start and duration of the event at the point, s, within the record."""
        start, duration = self.point.values[[self.places.time, self.places.duration]]
        start = min(start, self.descent.causes.duration)
        return start, min(duration, self.descent.causes.duration - start)

    def integrated(self) -> tuple[Point, Fit, float]:
        """
        Return the likeliest event, its fit, and what it gains over the one at the point, nats.

        The fit's evidence and its spread are those over all times and durations.

        Raises
        ------
        LinAlgError
            Where a prediction is not finite.

        """
        ramps, place, k = self.ramps, self.places, self.point.values.size
        likeliest = ramps.likeliest()
        order = np.r_[place.time, place.duration, place.size, self.others]
        values = np.empty(k)
        values[order] = likeliest[:k]
        values[order[2:]] += self.descent.slab.centre[order[2:]]
        values = np.clip(values, *self.descent.causes.bounds)
        point = self.descent.linearise(values, *self.descent.at(values))
        point = self.descent.checked(point, values, self.descent.fit(point).deviations)
        fit = self.descent.fit(point)
        held = fit.moments.without((place.time, place.duration))
        here, there = (float(ramps.likelihood_of(ramps.shares_of(start, duration)))
                       for start, duration in (self._own, likeliest[:2]))
        away = np.r_[values[order[:2]], fit.moments.away[order[2:]], fit.deviations]
        covariance, order = np.empty_like(fit.covariance), np.r_[
            order, k:k + fit.deviations.size]
        covariance[np.ix_(order, order)] = ramps.spread(away)
        # Where windows disagree, as much wider as without.
        wider = np.sqrt(np.diagonal(fit.covariance)
                        / np.diagonal(fit.moments.joined(fit.scale).covariance))
        return point, replace(
            fit, covariance=wider[:, None] * covariance * wider,
            log_evidence=held.log_evidence(fit.scale) + ramps.log_mass - there), there - here
