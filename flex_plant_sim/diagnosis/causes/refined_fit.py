"""Sets of causes: what to fit and where to start, and the fits, around others and themselves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.event_time import event_indices, EventTimeIntegral
from flex_plant_sim.diagnosis.causes.fit import (
    Fit,
    fit_set,
    GaussNewton,
    LinearisationPoint,
    NOTABLE_EXCESS,
)
from flex_plant_sim.diagnosis.causes.hypothesis import CauseSet, Hypothesis
from flex_plant_sim.diagnosis.causes.proposal import Proposal
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.prior import with_deviations
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.record.data import Data
import numpy as np

# What a linearisation misstates by more than this, nats, where it says the best fit is, or values
# that are so unlikely where it was made, are linearised around again, up to so many times.
LINEARISATION_ERROR, MAX_RELINEARISATIONS = 1.0, 6
# Parts further off than this, in tolerances, stand for a cause.
FAR_TOLERANCES = 3.0


@dataclass(frozen=True)
class CandidateSet:
    """A set of causes to fit, and where to start: values (k,) each, deviations of the parts."""

    hypotheses: tuple[Hypothesis, ...]
    starts: tuple[Array, ...]
    deviations: Array | None = None

    @classmethod
    def of(cls, fit: Fit) -> CandidateSet:
        """Return a fit as a trial."""
        return cls(fit.hypotheses, (fit.values,), fit.deviations)

    @property
    def labels(self) -> frozenset[str]:
        """Return the labels of the causes."""
        return frozenset(h.label for h in self.hypotheses)

    def without(self, place: int) -> CandidateSet:
        """Return the set with one cause less."""
        pieces = CauseSet(self.hypotheses, 1.0).split(self.starts[0])
        rest = [piece for k, piece in enumerate(pieces) if k != place]
        return CandidateSet(self.hypotheses[:place] + self.hypotheses[place + 1:],
                     (np.concatenate([np.zeros(0), *rest]),))

    def with_proposal(self, promise: Proposal) -> CandidateSet:
        """Return the set with one cause more."""
        return CandidateSet((*self.hypotheses, promise.hypothesis),
                     tuple(np.concatenate([self.starts[0], start]) for start in promise.starts))

    def with_each_size(self, promise: Proposal) -> Iterator[CandidateSet]:
        """Return the set with one cause more, and from each of its sizes: between are valleys."""
        yield self.with_proposal(promise)
        for start in promise.probe_starts:
            yield self.with_proposal(replace(promise, starts=(start,)))


@dataclass(frozen=True)
class RefinedFit:
    """A set with the likelihood linearised around it, and its fit there."""

    likelihood: Likelihood
    point: LinearisationPoint
    fit: Fit
    # With the same values and the file's parts, where those were asked on the way.
    at_file_parts: Likelihood | None = None

    @classmethod
    def refine(cls, trial: CandidateSet, base: BaseModel, data: Data, error_scale: Array | None = None,
           jobs: int = 1, worth_refining: Callable[[Fit, float], bool] = lambda fit, remainder: True
           ) -> RefinedFit:
        """
        Return a set fitted around itself: around its values and its parts, Gauss-Newton in both.

        Each fit is judged by what the record leaves with its own values and parts, so that two of
        them compare wherever they were linearised; of several the best counts. What says when an
        event happened is integrated over, and where another time is likelier it is fitted there.

        Parameters
        ----------
        trial : Trial
            The set and where to start.
        base : Base
            What it is added to.
        data : Data
            The records.
        scale : Array, optional
            By how much errors exceed what is stated, (m,).
        jobs : int
            Processes.
        matters : Callable
            Told a fit and how many nats more the set may have, whether it is to be settled on.

        """
        found, gained = cls._relinearised(trial, base, data, error_scale, jobs, worth_refining)._integrated_over_event()
        if gained > LINEARISATION_ERROR and worth_refining(found.fit, gained):
            again, _ = cls._relinearised(CandidateSet.of(found.fit), base, data, error_scale, jobs,
                                   worth_refining)._integrated_over_event()
            found = max(again, found, key=lambda s: s.fit.log_evidence)
        return found

    def extended_model(self, nominal: BaseModel) -> BaseModel:
        """Return the nominal base with the parts as re-estimated and the causes on."""
        parts, fit = self.likelihood.parts, self.fit
        kept = np.where([part.in_robot for part in parts], fit.deviations, 0.0)
        robot, sensors = with_deviations(nominal.robot, parts, kept)
        causes = CauseSet(fit.hypotheses, 1.0).effects(fit.values)
        return replace(nominal, robot=robot, effects=(*nominal.effects, *sensors, *causes))

    def _integrated_over_event(self) -> tuple[RefinedFit, float]:
        """Return the set with its event at the likeliest time, and what that gains, nats."""
        descent = GaussNewton(self.likelihood, self.causes, self.fit.error_scale)
        places = event_indices(descent)
        if places is None or self.fit.statistics.offsets[places.size] == 0.0:
            return self, 0.0
        point, fit, gained = EventTimeIntegral(descent, self.point, places).integrated()
        return replace(self, point=point, fit=fit), gained

    @classmethod
    def _relinearised(cls, trial: CandidateSet, base: BaseModel, data: Data, error_scale: Array | None, jobs: int,
                worth_refining: Callable[[Fit, float], bool]) -> RefinedFit:
        """
        Return a set fitted around itself, by the curvature there.

        What a linearisation promised and what is there tell how wrong it may be: a set that by so
        much more than was promised would still not matter is left there.
        """
        causes, starts = CauseSet(trial.hypotheses, data.duration), trial.starts
        known = np.ones(len(data.noise[0])) if error_scale is None else error_scale
        centre_deviations, best, at_file_parts = trial.deviations, None, None
        for _ in range(MAX_RELINEARISATIONS):
            likelihood = Likelihood(base, data.windows, data.noise, causes.effects(starts[0]),
                                    centre_deviations, jobs)
            if centre_deviations is None:
                at_file_parts = likelihood
            descent = GaussNewton(likelihood, causes, known)
            predicted = descent.minimise(starts) if best is None else descent.descend(starts)
            predicted_fit = descent.fit(predicted)
            point, centre_deviations = _exact_point(descent, starts[0], predicted, predicted_fit.deviations)
            found = cls(likelihood, point, descent.fit(point))
            rises = best is None or _significant_gain(found.fit, best.fit) > 0.0
            if best is None or found.fit.log_evidence > best.fit.log_evidence:
                best = found
            way, k = point.values - starts[0], point.values.size
            gone = 0.5 * float(way @ np.linalg.solve(predicted_fit.covariance[:k, :k], way))
            if not rises or (_significant_gain(found.fit, predicted_fit) == 0.0 and gone < LINEARISATION_ERROR):
                break
            missed = predicted_fit.log_evidence - found.fit.log_evidence
            if not worth_refining(found.fit, max(missed, 0.0) + abs(missed)):
                break
            starts = (point.values,)
        assert best is not None
        return best if causes.hypotheses else replace(best, at_file_parts=at_file_parts)

    def near_file_parts(self, base: BaseModel, data: Data, jobs: int = 1) -> RefinedFit:
        """
        Return no cause as sets of one are proposed and fitted from.

        Parts far off stand for a cause: with it they are near their file, and from where they are
        nothing tells so (one mode a link: 480 nats from the file, -54 from parts that are 7
        tolerances off). Then it is linearised around the file's parts.
        """
        if np.max(np.abs(self.fit.deviations / self.likelihood.tolerances)) <= FAR_TOLERANCES:
            return self
        likelihood = self.at_file_parts or Likelihood(base, data.windows, data.noise, (), None, jobs)
        descent = GaussNewton(likelihood, self.causes, self.fit.error_scale)
        point = descent.minimise((self.fit.values,))
        return RefinedFit(likelihood, point, descent.fit(point))

    @cached_property
    def with_own_filters(self) -> RefinedFit:
        """Return the same set as each arm's own filter sees it, for what starts far off."""
        descent = GaussNewton(self.likelihood.with_own_filters, self.causes, self.fit.error_scale)
        values = self.fit.values
        point = descent.linearise(values, *descent.residual_and_cost(values))
        return RefinedFit(self.likelihood.with_own_filters, point, descent.fit(point))

    @cached_property
    def causes(self) -> CauseSet:
        """Return the causes that are on."""
        return CauseSet(self.fit.hypotheses, self.likelihood.duration)


def _significant_gain(fit: Fit, other: Fit) -> float:
    """Return by how much one has more evidence, nats; 0 where that is not known."""
    more, unsure = fit.log_evidence - other.log_evidence, LINEARISATION_ERROR
    if np.any(fit.error_scale > NOTABLE_EXCESS):
        # Such errors are no white ones: their nats are known as far as windows agree.
        each = fit.window_log_likelihoods - other.window_log_likelihoods
        unsure = max(unsure, float(np.sqrt(each.size) * np.std(each)))
    return more if abs(more) > unsure else 0.0


def _exact_point(descent: GaussNewton, start: Array, predicted: LinearisationPoint, centre_deviations: Array) -> tuple[LinearisationPoint, Array]:
    """Return where a descent ends with its parts, exact there; the middle if that leaves less."""
    point = descent.exact_at(predicted, predicted.values, centre_deviations)
    if point.cost > predicted.cost + LINEARISATION_ERROR:
        halfway = 0.5 * (descent.likelihood.centre_deviations + centre_deviations)
        nearer = descent.exact_at(predicted, 0.5 * (start + predicted.values), halfway)
        if nearer.cost < point.cost:
            return nearer, halfway
    return point, centre_deviations


@dataclass(frozen=True)
class NeighbourFitter:
    """
    Fits sets around the linearisation of one near them.

    Where a set has coordinates that rest along the trajectory of that one, then once more along
    its own, the parts' columns being those of the one near it.
    """

    likelihood: Likelihood
    error_scale: Array
    duration: float
    coarse: bool = False

    def __call__(self, trial: CandidateSet) -> Fit:
        causes = CauseSet(trial.hypotheses, self.duration)
        near = fit_set(self.likelihood, causes, trial.starts, self.error_scale, self.coarse)
        effects = causes.effects(near.values)
        if self.coarse or not self.likelihood.has_new_coordinates(effects):
            return near
        return fit_set(self.likelihood.along_trajectory_of(effects), causes, (near.values,), self.error_scale)
