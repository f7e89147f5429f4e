"""
Refined fits: a set of causes with the likelihood linearised around its own optimum.

Only refined fits of different sets are compared as evidence. The search refines the sets that may
be the most probable.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.event_time import event_indices, EventTimeIntegral
from flex_plant_sim.diagnosis.causes.fit import Fit, NOTABLE_EXCESS
from flex_plant_sim.diagnosis.causes.gauss_newton import GaussNewton, LinearisationPoint
from flex_plant_sim.diagnosis.causes.hypothesis import CauseSet
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.prior import with_deviations
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.record.data import Data
import numpy as np
from scipy.special import chdtri

# Error of a linearisation, nats, above which it is repeated at the new optimum; and how often.
LINEARISATION_ERROR, MAX_RELINEARISATIONS = 1.0, 6
# Uncertainty of a fit's gain over the set around which it is linearised, and of what refinement
# adds, as a share of that gain: the parts are moved to where they were not linearised. (By being
# refined, four sets around one centre gained 295 to 345 nats, two around another 196 and 202.)
GAIN_UNCERTAINTY = 0.3
# Probability with which parts within their tolerances deviate by as much as where they are said to
# stand for a cause. (Beside the right causes of four arms the sum of squares was 1.6 to 9, of 31
# parts; beside a ripple that hid a bulky payload 436.)
PARTS_LEVEL = 1e-3
# Samples of the windows that sensitivities and coarse fits use; a budget.
COARSE_SAMPLES = 1600

# (fit, nats that the set may have more) -> whether refining the set further is worth it.
WorthRefining = Callable[[Fit, float], bool]


@dataclass(frozen=True)
class RefinedFit:
    """
    A set of causes with the likelihood linearised around it, and its fit there.

    Attributes
    ----------
    likelihood : Likelihood
    point : LinearisationPoint
    fit : Fit
    at_file_parts : Likelihood, optional
        With the same values and no deviations of the parts, where that was needed on the way.

    """

    likelihood: Likelihood
    point: LinearisationPoint
    fit: Fit
    at_file_parts: Likelihood | None = None

    @classmethod
    def refine(cls, candidate: CandidateSet, base: BaseModel, data: Data,
               error_scale: Array | None = None, jobs: int = 1,
               worth_refining: WorthRefining = lambda fit, more: True) -> RefinedFit:
        """
        Return a set fitted and linearised around its own values and parts.

        Every fit on the way is evaluated exactly at its own values and parts, so that refined fits
        compare wherever they began; the best counts. The time and duration of an event are
        integrated over; where another time turns out likelier, the set is refined again there.

        Parameters
        ----------
        candidate : CandidateSet
            The set and where to start.
        base : BaseModel
            The model that the causes are added to.
        data : Data
            The records.
        error_scale : Array, optional
            Factor of the errors over what the filter states, (m,); 1 by default.
        jobs : int
            Processes.
        worth_refining : Callable
            Decides whether a further linearisation is worth its passes.

        """
        def refined(candidate: CandidateSet) -> tuple[RefinedFit, float]:
            return cls._relinearised(candidate, base, data, error_scale, jobs,
                                     worth_refining)._integrated_over_event()

        found, gained = refined(candidate)
        if gained > LINEARISATION_ERROR and worth_refining(found.fit, gained):
            again, _ = refined(CandidateSet.of(found.fit))
            found = max(again, found, key=lambda r: r.fit.log_evidence)
        return found

    def extended_model(self, nominal: BaseModel) -> BaseModel:
        """Return the nominal model with the causes and the estimated parts."""
        parts, fit = self.likelihood.parts, self.fit
        deviations = np.where([part.in_robot for part in parts], fit.deviations, 0.0)
        robot, sensors = with_deviations(nominal.robot, parts, deviations)
        causes = CauseSet(fit.hypotheses, 1.0).effects(fit.values)
        return replace(nominal, robot=robot, effects=(*nominal.effects, *sensors, *causes))

    def _integrated_over_event(self) -> tuple[RefinedFit, float]:
        """Return the fit integrated over its event's time, and the gain of that time, nats."""
        solver = GaussNewton(self.likelihood, self.causes, self.fit.error_scale)
        indices = event_indices(solver)
        if indices is None or self.fit.statistics.offsets[indices.size] == 0.0:
            return self, 0.0
        point, fit, gained = EventTimeIntegral(solver, self.point, indices).integrated()
        return replace(self, point=point, fit=fit), gained

    @classmethod
    def _relinearised(cls, candidate: CandidateSet, base: BaseModel, data: Data,
                      error_scale: Array | None, jobs: int, worth_refining: WorthRefining
                      ) -> RefinedFit:
        """
        Return a set linearised around its optimum, at a fixed time of its event.

        The difference between predicted and exact evidence tells how wrong the linearisation may
        be. Where it is small, only the trajectory is taken anew and the parts' Jacobian, a pass a
        part, is kept. A set that would not matter with so much more evidence is not refined
        further.
        """
        causes, starts = CauseSet(candidate.hypotheses, data.duration), candidate.starts
        scale = np.ones(len(data.noise[0])) if error_scale is None else error_scale
        likelihood = Likelihood(base, data.windows, data.noise, causes.effects(starts[0]),
                                candidate.deviations, jobs)
        at_file_parts = likelihood if candidate.deviations is None else None
        best = None
        for _ in range(MAX_RELINEARISATIONS):
            solver = GaussNewton(likelihood, causes, scale)
            predicted = solver.descend(starts)
            predicted_fit = solver.fit(predicted)
            point, deviations = _exact_point(solver, starts[0], predicted,
                                             predicted_fit.deviations)
            found = cls(likelihood, point, solver.fit(point))
            improves = best is None or _significant_gain(found.fit, best.fit) > 0.0
            if best is None or found.fit.log_evidence > best.fit.log_evidence:
                best = found
            step = np.concatenate([point.values - starts[0],
                                   deviations - likelihood.centre_deviations])
            distance = 0.5 * float(step @ np.linalg.solve(predicted_fit.covariance, step))
            as_predicted = _significant_gain(found.fit, predicted_fit) == 0.0
            if not improves or (as_predicted and distance < LINEARISATION_ERROR):
                break
            missing = predicted_fit.log_evidence - found.fit.log_evidence
            # The step's own gain, `distance` nats, was linear as well.
            uncertainty = max(abs(missing), GAIN_UNCERTAINTY * distance)
            if not worth_refining(found.fit, max(missing, 0.0) + uncertainty):
                break
            starts, effects = (point.values,), causes.effects(point.values)
            likelihood = (
                likelihood.along_trajectory_of(effects, deviations)
                if abs(missing) < LINEARISATION_ERROR else
                Likelihood(base, data.windows, data.noise, effects, deviations, jobs))
        assert best is not None
        return best if causes.hypotheses else replace(best, at_file_parts=at_file_parts)

    @property
    def parts_stand_for_a_cause(self) -> bool:
        """Tell whether the parts deviate by more than parts within their tolerances do."""
        deviations = self.fit.deviations / self.likelihood.tolerances
        return bool(deviations @ deviations > chdtri(deviations.size, PARTS_LEVEL))

    def near_file_parts(self, base: BaseModel, data: Data, jobs: int = 1) -> RefinedFit:
        """
        Return the fit of the same causes linearised around the file's parts.

        Without its cause, parts that are off stand for it, and linearised there the cause is not
        seen; with the cause they are as near their file as their prior says. (With one mode a
        link, the missing modes gain 480 nats from there and lose 54 nats from parts that are 7
        tolerances off; a base that gives way gains 12 nats and loses 17 from parts that are 2.5
        off. Beside a ripple, the payload's inertia gains 140 nats, and 22 from parts 18 off.)
        """
        values = self.fit.values
        likelihood = self.at_file_parts or Likelihood(
            base, data.windows, data.noise, self.causes.effects(values), None, jobs)
        solver = GaussNewton(likelihood, self.causes, self.fit.error_scale)
        point = solver.descend((values,))
        return RefinedFit(likelihood, point, solver.fit(point))

    def beside(self, base: BaseModel, data: Data, jobs: int = 1) -> RefinedFit:
        """
        Return the same causes, parts and error scales beside another base model.

        Without a law of the present one, what that explained is in the residual.
        """
        values = self.fit.values
        likelihood = Likelihood(base, data.windows, data.noise, self.causes.effects(values),
                                self.fit.deviations, jobs)
        solver = GaussNewton(likelihood, self.causes, self.fit.error_scale)
        point = solver.linearise(values, *solver.residual_and_cost(values))
        return RefinedFit(likelihood, point,
                          replace(solver.fit(point), error_scale=self.fit.error_scale))

    @cached_property
    def coarse(self) -> RefinedFit:
        """Return the same set and values on busy windows, `Likelihood.with_own_filters`."""
        likelihood = self.likelihood.thinned(COARSE_SAMPLES, busiest=True).with_own_filters
        solver = GaussNewton(likelihood, self.causes, self.fit.error_scale)
        values = self.fit.values
        point = solver.linearise(values, *solver.residual_and_cost(values))
        return RefinedFit(likelihood, point, solver.fit(point))

    @cached_property
    def causes(self) -> CauseSet:
        """Return the causes."""
        return CauseSet(self.fit.hypotheses, self.likelihood.duration)


def _significant_gain(fit: Fit, other: Fit) -> float:
    """Return the evidence of one fit over another, nats; 0 where it is within its uncertainty."""
    gain, uncertainty = fit.log_evidence - other.log_evidence, LINEARISATION_ERROR
    if np.any(fit.error_scale > NOTABLE_EXCESS):
        # Such errors are not white; the gain is as uncertain as windows disagree.
        by_window = fit.window_log_likelihoods - other.window_log_likelihoods
        uncertainty = max(uncertainty, float(np.sqrt(by_window.size) * np.std(by_window)))
    return gain if abs(gain) > uncertainty else 0.0


def _exact_point(solver: GaussNewton, start: Array, predicted: LinearisationPoint,
                 deviations: Array) -> tuple[LinearisationPoint, Array]:
    """Return the predicted optimum and parts, exact there; halfway to them if that is better."""
    point = solver.exact_at(predicted, predicted.values, deviations)
    if point.cost > predicted.cost + LINEARISATION_ERROR:
        halfway = 0.5 * (solver.likelihood.centre_deviations + deviations)
        nearer = solver.exact_at(predicted, 0.5 * (start + predicted.values), halfway)
        if nearer.cost < point.cost:
            return nearer, halfway
    return point, deviations
