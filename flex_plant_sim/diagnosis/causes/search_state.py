"""
The state that all steps of the search share: the records, what is fitted, what is refined.

`search` drives it through the steps in `proposal_step`, `neighbours` and `refinement`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses, Hypothesis
from flex_plant_sim.diagnosis.causes.posterior import (
    interpretations,
    log_prior,
    Posterior,
    SetKey,
)
from flex_plant_sim.diagnosis.causes.proposal import Proposal
from flex_plant_sim.diagnosis.causes.refined_fit import GAIN_UNCERTAINTY, RefinedFit
from flex_plant_sim.diagnosis.causes.sensitivity import Sensitivity
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.prior import log_prior_odds
from flex_plant_sim.diagnosis.pool import each
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
from flex_plant_sim.diagnosis.record.data import Data
import numpy as np

# Called with a step's name and its share of the whole that is done.
Progress = Callable[[str, float], None]

# Proposals fitted at most beside a set or in the place of one of its causes (a budget), and
# fitted always, whatever their gain.
MAX_ADDED, ALWAYS_FITTED = 12, 2
# Probability, relative to that of the best set, below which a set is not worth stating; and the
# score by which it may be behind, nats.
MIN_RELATIVE_PROBABILITY = 0.05
MAX_DEFICIT = -float(np.log(MIN_RELATIVE_PROBABILITY))


class SearchState:
    """
    The sets that were fitted and refined so far, their scores, and the sensitivities.

    Parameters
    ----------
    data : Data
        The records.
    nominal : BaseModel
        The model in question.
    jobs : int
        Processes.
    exclude : sequence of str
        Identifiers to leave out of the catalogue.
    progress : Callable
        Called with a step's name and its share done.

    Attributes
    ----------
    catalogue : list of Hypothesis
    fits : dict
        The latest fit of each set, refined or not.
    refined : dict
        The best refined fit of each set.
    coarse_fits : dict
        The coarse fits of each set's neighbours.
    sensitivities : list
        Of each hypothesis.
    thinned : Likelihood
        Of the windows that sensitivities and coarse fits use.
    resonant : frozenset of str
        Labels of the effects with a coordinate of their own; their size sets a frequency.

    """

    def __init__(self, data: Data, nominal: BaseModel, jobs: int, exclude: Sequence[str],
                 progress: Progress):
        self.data, self.nominal, self.jobs, self.progress = data, nominal, jobs, progress
        told = {f'{effect.identifier}:{effect.site}' for effect in nominal.effects}
        self.catalogue = [h for h in all_hypotheses(nominal.robot, exclude) if h.label not in told]
        self.fits: dict[SetKey, Fit] = {}
        self.refined: dict[SetKey, RefinedFit] = {}
        self.coarse_fits: dict[SetKey, list[Fit]] = {}
        self.sensitivities: list[tuple[Hypothesis, tuple[Sensitivity, ...]]] = []
        self.thinned: Likelihood
        self.resonant: frozenset[str] = frozenset()

    def refine(self, candidate: CandidateSet, discrepancy: DiscrepancyModel,
               error_scale: Array | None = None) -> RefinedFit:
        """Refine a set and keep the result; return the best refined fit of that set so far."""
        return self._keep(self._refined(candidate, discrepancy, error_scale))

    def refine_each(self, fits: Sequence[Fit]) -> None:
        """Refine fits in parallel and keep the results; none depends on another's."""
        for found in self.refined_each(fits):
            self._keep(found)

    def refined_each(self, fits: Sequence[Fit]) -> list[RefinedFit]:
        """Return fits refined in parallel, without those that cannot be; none is kept."""
        return each(lambda fit: self._refined(CandidateSet.of(fit), fit.discrepancy,
                                              fit.error_scale), fits, self.jobs,
                    lambda share: self.progress('linearising the leading', 0.9))

    def refine_smaller(self, smaller: Sequence[tuple[Fit, int]]) -> None:
        """Refine fits without one of their causes in parallel, from their values and parts."""
        def refined(what: tuple[Fit, int]) -> RefinedFit:
            fit, index = what
            discrepancy = replace(fit.discrepancy, remainder=False)
            return self._refined(CandidateSet.of(fit).without(index), discrepancy,
                                 fit.error_scale)

        for found in each(refined, smaller, self.jobs,
                          lambda share: self.progress('linearising the leading', 0.9)):
            self._keep(found)

    def refine_to_the_end(self, candidates: Sequence[CandidateSet]) -> None:
        """Refine sets in parallel, whatever they seem worth on the way, and keep the results."""
        def refined(candidate: CandidateSet) -> RefinedFit:
            return RefinedFit.refine(candidate, self.nominal, self.data)

        for found in each(refined, candidates, self.jobs,
                          lambda share: self.progress('one cause for all', 0.9)):
            self._keep(found)

    def _refined(self, candidate: CandidateSet, discrepancy: DiscrepancyModel,
                 error_scale: Array | None) -> RefinedFit:
        base = replace(self.nominal, discrepancy=discrepancy)
        return RefinedFit.refine(candidate, base, self.data, error_scale, self.jobs,
                                 self.worth_refining)

    def _keep(self, found: RefinedFit) -> RefinedFit:
        """Keep the better of a refined fit and the one known of its set; return it."""
        key = SetKey.of(found.fit)
        found = max(found, self.refined.get(key, found), key=lambda r: self.score(r.fit))
        self.fits[key], self.refined[key] = found.fit, found
        return found

    def keep_light_without_laws(self) -> None:
        """Keep of refined sets without laws what is read where sets with laws lead: the fits."""
        for key, found in self.refined.items():
            if not found.fit.discrepancy.laws:
                self.refined[key] = RefinedFit(found.likelihood.light, found.point, found.fit)

    def worth_refining(self, fit: Fit, more: float = 0.0) -> bool:
        """Tell whether a set would be worth stating if it had more evidence, nats."""
        best = max((self.best_score(r.fit) for r in self.refined.values()), default=-np.inf)
        return self.attainable_score(fit) + more > best - MAX_DEFICIT

    def attainable_score(self, fit: Fit) -> float:
        """Return the best score, nats, or what it is if refinement takes away what errors cost."""
        return max(self.best_score(fit), self.score(fit))

    def score(self, fit: Fit) -> float:
        """Return the logarithm of a set's posterior odds, up to a constant, nats."""
        return fit.log_evidence + log_prior(fit, self.nominal)

    def best_score(self, fit: Fit) -> float:
        """Return the score of the more probable interpretation of a fit, nats."""
        return self.score(self.best_interpretation(fit))

    def best_interpretation(self, fit: Fit) -> Fit:
        """Return the more probable interpretation of a fit."""
        return max(interpretations(fit), key=self.score)

    def score_margin(self, best: Fit, centre: RefinedFit, least: float) -> float:
        """Return by how much a set's score may be behind the best around a centre, nats."""
        return max(GAIN_UNCERTAINTY * (self.score(best) - self.score(centre.fit)), least)

    @property
    def best(self) -> RefinedFit:
        """Return the most probable refined fit, of those without a far part if there is one."""
        return max(self.refined.values(), key=lambda r: (
            not r.fit.discrepancy.far_part, self.score(r.fit)))

    @property
    def refined_with_laws(self) -> list[RefinedFit]:
        """Return the refined fits with laws of unknown torques and without a far part."""
        return [found for found in self.refined.values()
                if found.fit.discrepancy.laws and not found.fit.discrepancy.far_part]

    def penalised_gain(self, proposal: Proposal) -> float:
        """Return a proposal's linear gain with its prior odds, nats."""
        return proposal.linear_gain + log_prior_odds(
            proposal.hypothesis.effect, self.nominal.robot)

    def score_at_null(self, proposal: Proposal) -> float:
        """Return a proposal's prior odds without what its freedom costs, nats."""
        return log_prior_odds(proposal.hypothesis.effect, self.nominal.robot) - proposal.occam

    def deserves_fit(self, rank: int, proposal: Proposal) -> bool:
        """
        Tell whether a proposal is to be fitted, by its rank among the proposals.

        Of resonant effects the linear gain may be far too small, so that their rank is not known.
        """
        ranked = rank < MAX_ADDED or proposal.hypothesis.label in self.resonant
        return rank < ALWAYS_FITTED or (ranked and self.promises_gain(proposal))

    def promises_gain(self, proposal: Proposal) -> bool:
        """Tell whether a proposal would be worth stating by its linear gain."""
        return self.penalised_gain(proposal) > -MAX_DEFICIT

    def posterior(self, unfitted_scores: Mapping[frozenset[str], float] = MappingProxyType({}),
                  beside: Fit | None = None, parts_vary: bool = False) -> Posterior:
        """Return the posterior over all fitted sets, and over some that were not fitted."""
        return Posterior.of(list(self.fits.values()), self.nominal, unfitted_scores, beside,
                            parts_vary)
