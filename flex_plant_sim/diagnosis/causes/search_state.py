"""The steps of a search: looks, promises, fits near a set, sets linearised around themselves."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import replace

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.fit import Fit, NOTABLE_EXCESS, with_far_part
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses, Hypothesis
from flex_plant_sim.diagnosis.causes.part_factors import fits_replacing_parts
from flex_plant_sim.diagnosis.causes.posterior import interpretations, log_prior, Posterior, SetKey
from flex_plant_sim.diagnosis.causes.proposal import Proposal, ProposalScorer
from flex_plant_sim.diagnosis.causes.refined_fit import (
    CandidateSet,
    LINEARISATION_ERROR,
    NeighbourFitter,
    RefinedFit,
)
from flex_plant_sim.diagnosis.causes.sensitivity import Sensitivity, SensitivityProbe
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.prior import log_prior_odds, parts_without_effect
from flex_plant_sim.diagnosis.likelihood.sufficient_statistics import TEMPER
from flex_plant_sim.diagnosis.pool import attempt, each
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
from flex_plant_sim.diagnosis.prediction.latent_view import latent_view, law_effect
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.diagnosis.record.data import Data
import numpy as np

Progress = Callable[[str, float], None]

# A budget, no judgement: hypotheses tried beside a set and in place of each, sets fitted to all
# windows, samples of those windows that proposals come from.
MAX_ADDED, MAX_ALTERNATIVES, MAX_FITTED, MAX_REFITTED, COARSE_SAMPLES = 12, 5, 6, 1, 1600
# What promises less than this, nats with its price, has no share worth stating, but for the few
# best; nor has what a fit to some windows leaves so far behind, nor a set less probable.
MIN_PROPOSAL_GAIN, ALWAYS_FITTED, MAX_COARSE_DEFICIT, MIN_RELATIVE_PROBABILITY = -1.0, 2, 30.0, 0.05
# Around another set, a fit knows its gain over that to such a share: parts go where they were not
# linearised. So many of those that may lead are linearised around themselves at a time.
GAIN_UNCERTAINTY, MAX_REFINED_AT_ONCE = 0.3, 3
# What promises less than this share of a cause cannot stand in its place; one that promises more
# than this, nats, is not dropped.
MIN_ALTERNATIVE_SHARE, INDISPENSABLE_GAIN = 0.3, 60.0


class SearchState:
    """What all steps of a search share."""

    def __init__(self, data: Data, nominal: BaseModel, jobs: int, exclude: Sequence[str],
                 progress: Progress):
        self.data, self.nominal, self.jobs, self.progress = data, nominal, jobs, progress
        self.catalogue = [h for h in all_hypotheses(nominal.robot, exclude)
                          if not any(h.effect is type(e) for e in nominal.effects)]
        self.fits_by_key: dict[SetKey, Fit] = {}
        self.refined: dict[SetKey, RefinedFit] = {}
        self.thinned: Likelihood
        self.start_deviations: Array | None = None
        self.sensitivities: list[tuple[Hypothesis, tuple[Sensitivity, ...]]] = []
        # Labels of what has a coordinate of its own: its size is a frequency.
        self.resonant: frozenset[str] = frozenset()
        self.coarse_fits: dict[SetKey, list[Fit]] = {}

    def with_discrepancy_behind_sensors(self) -> SearchState:
        """
        Return the course as it begins anew where sensors see what is unmodelled.

        What the arms' own filters err is the same: all looks, and the rough fits beside nothing.
        """
        def moved(fit: Fit) -> Fit:
            return replace(fit, discrepancy=replace(fit.discrepancy, behind_sensors=True))

        other, discrepancy = copy(self), replace(self.nominal.discrepancy, behind_sensors=True)
        other.nominal = replace(self.nominal, discrepancy=discrepancy)
        other.fits_by_key, other.refined = {}, {}
        nothing = SetKey(frozenset(), self.nominal.discrepancy)
        other.coarse_fits = {replace(nothing, discrepancy=discrepancy): [moved(f) for f in self.coarse_fits[nothing]]}
        other.start_deviations = self.refined[nothing].fit.deviations
        return other

    def refine(self, trial: CandidateSet, discrepancy: DiscrepancyModel, error_scale: Array | None = None) -> RefinedFit:
        """Return a set fitted around itself, the best of its ends, known from now on."""
        return self._remembered(self._refined(trial, discrepancy, error_scale))

    def _refined(self, trial: CandidateSet, discrepancy: DiscrepancyModel, error_scale: Array | None) -> RefinedFit:
        base = replace(self.nominal, discrepancy=discrepancy)
        return RefinedFit.refine(trial, base, self.data, error_scale, self.jobs, self.worth_refining)

    def _refine_each(self, fits: Sequence[Fit]) -> None:
        """Settle what was fitted, side by side: none is told what another finds."""
        for found in each(lambda fit: self._refined(CandidateSet.of(fit), fit.discrepancy, fit.error_scale),
                          fits, self.jobs):
            self._remembered(found)

    def _remembered(self, found: RefinedFit) -> RefinedFit:
        """Return the better of what was found and what is known of the set, known from now on."""
        key = SetKey.of(found.fit)
        found = max(found, self.refined.get(key, found), key=lambda s: self.score(s.fit))
        self.fits_by_key[key], self.refined[key] = found.fit, found
        return found

    def worth_refining(self, fit: Fit, more: float = 0.0) -> bool:
        """Tell whether a fit has a share worth stating beside the best, had it more nats."""
        best = max((self._best_score(s.fit) for s in self.refined.values()), default=-np.inf)
        return self._best_score(fit) + more > best + np.log(MIN_RELATIVE_PROBABILITY)

    def _best_score(self, fit: Fit) -> float:
        """Return the score of the likelier of what a fit stands for, nats."""
        return max(map(self.score, interpretations(fit)))

    def try_laws(self, explored: RefinedFit) -> None:
        """
        Fit a set with the laws of the torques that it leaves, where joints err too much.

        A further cause must explain more than the tables of torques that have no name. And what
        leads with those of another set has its own.
        """
        if not np.any(self.best.fit.error_scale[:2] > NOTABLE_EXCESS):
            return
        if not explored.fit.discrepancy.laws:
            self._refine_with_laws(explored)
        best = self.best
        if best.fit.discrepancy.laws and best.fit.hypotheses != explored.fit.hypotheses:
            self._refine_with_laws(best)

    def _refine_with_laws(self, centre: RefinedFit) -> None:
        """
        Linearise a set with the laws that hold of what it leaves around itself.

        Of joints that err too much: another's may be an echo, or a part within its tolerance.
        What laws leave of their errors are torques, too, at most as large as without them.
        """
        base = centre.extended_model(self.nominal)
        view = latent_view([Predictor(base, windows, noise) for windows, noise
                            in zip(self.data.locked, self.data.noise)])
        wrong = {f'joint_{k + 1}' for k in np.flatnonzero(centre.fit.error_scale[:2] > NOTABLE_EXCESS)}
        laws = [law for law in view.laws if law.site in wrong]
        if laws:
            discrepancy = replace(centre.fit.discrepancy, laws=tuple(map(law_effect, laws)),
                            laws_penalty=sum(law.occam_penalty for law in laws), torque_share=remaining_torque_shares(centre.fit))
            error_scale = np.concatenate([np.ones(2), centre.fit.error_scale[2:]])
            attempt(lambda trial: self.refine(trial, discrepancy, error_scale), CandidateSet.of(centre.fit))

    def probe(self, nothing: RefinedFit) -> None:
        """Look at all hypotheses."""
        self.thinned = nothing.with_own_filters.likelihood.thinned(COARSE_SAMPLES)
        self.sensitivities = each(SensitivityProbe(self.thinned, self.data.duration), self.catalogue, self.jobs,
                          lambda share: self.progress('looking at all causes', 0.4 * share))
        self.resonant = frozenset(h.label for h, (probe, *_) in self.sensitivities
                                  if self.thinned.has_new_coordinates((h.effect_at(probe.shape + probe.deviation),)))

    def proposal_scorer(self, centre: RefinedFit, left_out: int | None = None) -> ProposalScorer:
        """
        Return what promises beside a set, or beside it without one cause, are measured against.

        Proposals and rough fits go by the arms' own filters: what those err has fewer side
        valleys, and no error of one channel drowns it. Evidence does not.
        """
        centre = centre.with_own_filters
        fit, likelihood = centre.fit, centre.likelihood
        rest = np.ones(len(fit.values), dtype=bool)
        residual, ends = centre.point.residual, centre.causes.boundaries
        if left_out is not None:
            rest[ends[left_out]:ends[left_out + 1]] = False
            effects = centre.causes.effects(fit.values)
            residual = likelihood.residual(effects[:left_out] + effects[left_out + 1:])[0]
        columns = centre.point.jacobian[rest]
        plain = residual - np.tensordot(fit.statistics.offsets[rest], columns, 1)
        rows = np.concatenate([plain[None], columns, likelihood.part_jacobian])[
            ..., self.thinned.kept_samples]
        weight = np.repeat(1.0 / (fit.error_scale * np.sqrt(TEMPER)), rows.shape[-1])
        return ProposalScorer(
            np.sqrt(self.thinned.weight) * rows.reshape(len(rows), -1) * weight,
            np.concatenate([fit.statistics.prior.width[rest], likelihood.tolerances]), weight,
            self.data.duration)

    def proposals(self, centre: RefinedFit, left_out: int | None = None) -> list[Proposal]:
        """Return what all others promise beside a set, see `beside`, the best first."""
        proposal_scorer, on = self.proposal_scorer(centre, left_out), centre.fit.hypotheses
        labels = {h.label for k, h in enumerate(on) if k != left_out}
        found = [proposal_scorer.propose(h, sensitivities) for h, sensitivities in self.sensitivities if h.label not in labels]
        return sorted(found, key=lambda p: -self.penalised_gain(p))

    def penalised_gain(self, proposal: Proposal) -> float:
        """Return what a promise gains with its price, nats."""
        return proposal.linear_gain + log_prior_odds(proposal.hypothesis.effect, self.nominal.robot)

    def deserves_fit(self, place: int, proposal: Proposal) -> bool:
        """
        Tell whether a promise is worth a fit, by its place among the promises.

        What swings gains more than a line tells: its place is not known.
        """
        placed = place < MAX_ADDED or proposal.hypothesis.label in self.resonant
        return place < ALWAYS_FITTED or (placed and self.penalised_gain(proposal) > MIN_PROPOSAL_GAIN)

    def candidates(self, centre: RefinedFit, proposals: Sequence[Proposal]) -> Iterator[CandidateSet]:
        """Return a set and those near it that may be worth a fit."""
        now = CandidateSet.of(centre.fit)
        yield now
        added = [p for k, p in enumerate(proposals) if self.deserves_fit(k, p)]
        for proposal in {p.hypothesis.label: p for p in reversed(added)}.values():
            yield from self._extended_by(now, proposal)
        for place, cause in enumerate(now.hypotheses):
            rest, others = now.without(place), self.proposals(centre, place)
            own = max((self.penalised_gain(p) for p in others if p.hypothesis == cause), default=0.0)
            if own < INDISPENSABLE_GAIN:
                yield rest
            rivals = [p for p in others if p.hypothesis != cause and self.penalised_gain(p) > MIN_ALTERNATIVE_SHARE * own]
            for proposal in rivals[:MAX_ALTERNATIVES]:
                yield from self._extended_by(rest, proposal)

    def _extended_by(self, trial: CandidateSet, proposal: Proposal) -> Iterable[CandidateSet]:
        """Return a set with one cause more; of one that swings, from each of its sizes."""
        if proposal.hypothesis.label in self.resonant:
            return trial.with_each_size(proposal)
        return [trial.with_proposal(proposal)]

    def fit_neighbours(self, centre: RefinedFit) -> list[Proposal]:
        """Fit the sets near a set; return what further causes promise beside it."""
        proposals, step = self.proposals(centre), f'cause {len(centre.fit.hypotheses) + 1}'
        if SetKey.of(centre.fit) not in self.coarse_fits:
            self.coarse_fits[SetKey.of(centre.fit)] = self._coarse_fits(centre, proposals, step)
        coarse_fits = sorted(self.coarse_fits[SetKey.of(centre.fit)], key=lambda fit: -self.score(fit))
        near = [fit for fit in coarse_fits if SetKey.of(fit) != SetKey.of(centre.fit)
                and self.score(fit) > self.score(coarse_fits[0]) - self.score_margin(coarse_fits[0], centre, MAX_COARSE_DEFICIT)]
        fits = each(NeighbourFitter(centre.likelihood, centre.fit.error_scale, self.data.duration),
                    [CandidateSet.of(fit) for fit in self._selected(near)], self.jobs,
                    lambda share: self.progress(step, 0.7 + 0.2 * share))
        in_place = tuple(fits_replacing_parts(self.refined[SetKey.of(centre.fit)], self.catalogue))
        for fit in (*fits, *in_place):
            fits_by_key = self.fits_by_key.get(SetKey.of(fit), fit)
            if SetKey.of(fit) not in self.refined or self.score(fit) > self.score(fits_by_key) + LINEARISATION_ERROR:
                self.fits_by_key[SetKey.of(fit)] = fit
        self._refine_contenders(in_place, self.posterior().best, centre)
        return proposals

    def _coarse_fits(self, centre: RefinedFit, proposals: Sequence[Proposal], step: str) -> list[Fit]:
        """Return the sets near a set as some windows and the arms' own filters see them."""
        afar = centre.with_own_filters
        fits = each(NeighbourFitter(afar.likelihood.thinned(COARSE_SAMPLES), afar.fit.error_scale,
                           self.data.duration, True),
                    list(self.candidates(centre, proposals)), self.jobs,
                    lambda share: self.progress(step, 0.4 + 0.3 * share))
        # Of those that were fitted from several sizes, the best.
        return list({SetKey.of(fit): fit for fit in sorted(fits, key=self.score)}.values())

    def _selected(self, near: Sequence[Fit]) -> list[Fit]:
        """Return the first of what is not settled, and of what is, from where it came now."""
        fresh = [fit for fit in near if SetKey.of(fit) not in self.refined]
        return fresh[:MAX_FITTED] + [fit for fit in near if SetKey.of(fit) in self.refined][:MAX_REFITTED]

    def score_margin(self, best: Fit, centre: RefinedFit, least: float) -> float:
        """Return by how much a set may be behind the best around another and yet lead, nats."""
        return max(GAIN_UNCERTAINTY * (self.score(best) - self.score(centre.fit)), least)

    def score(self, fit: Fit) -> float:
        """Return the logarithm of a set's posterior odds against others, nats."""
        return fit.log_evidence + log_prior(fit, self.nominal)

    def posterior(self, centre: RefinedFit | None = None, proposals: Sequence[Proposal] = ()
               ) -> Posterior:
        """Return all sets with their probabilities, and what promised too little to be fitted."""
        promised = {} if centre is None else {
            SetKey.of(centre.fit).labels | {p.hypothesis.label}:
            self._best_score(centre.fit) + self.penalised_gain(p)
            for k, p in enumerate(proposals) if not self.deserves_fit(k, p)}
        return Posterior.of(list(self.fits_by_key.values()), self.nominal, promised)

    @property
    def best(self) -> RefinedFit:
        """Return the most probable set linearised around itself, all parts as their file says."""
        return max((s for s in self.refined.values() if not s.fit.discrepancy.far_part),
                   key=lambda s: self.score(s.fit))

    def refine_leading(self, centre: RefinedFit) -> None:
        """
        Linearise the sets that may lead around themselves, so that they compare.

        Those around the file's parts compare with one another alone.
        """
        fits = self.posterior().fits
        if centre.fit is not self.refined[SetKey.of(centre.fit)].fit:
            fits = tuple(fit for fit in fits if SetKey.of(fit).without_remainder not in self.refined)
        if fits:
            self._refine_contenders(fits[:MAX_REFINED_AT_ONCE], fits[0], centre)

    def refine_alternatives(self, best: RefinedFit, centre: RefinedFit) -> None:
        """Linearise what is likeliest in the place of each cause of a set around itself."""
        posterior, labels = self.posterior(), SetKey.of(best.fit).labels
        rivals = {label: fit for fit in reversed(posterior.fits) for label in labels
                  if labels - SetKey.of(fit).labels == {label}}
        self._refine_contenders(tuple(rivals.values()), posterior.best, centre)

    def _refine_contenders(self, fits: Sequence[Fit], best: Fit, centre: RefinedFit) -> None:
        """Linearise sets, as judged, around themselves that may lead for all a centre knows."""
        least = self.score(best) - self.score_margin(best, centre, -np.log(MIN_RELATIVE_PROBABILITY))
        refined = [found.fit for found in self.refined.values()]
        leading = dict.fromkeys(SetKey.of(fit).without_remainder for fit in fits if self.score(fit) >= least)
        # What cannot be settled is known no more.
        self._refine_each([
            self.fits_by_key.pop(key) for key in leading
            if key in self.fits_by_key and not any(self.fits_by_key[key] is fit for fit in refined)])

    def try_far_parts(self) -> None:
        """
        Judge the settled sets with each part not as its file says; that costs no pass.

        What a part far off gains is known to a share only: what may lead is fitted around it.
        """
        asked = {h.effect.identifier for h in self.catalogue}
        best = max(map(self.score, self.fits_by_key.values()))
        may_lead = []
        for centre in self.refined.values():
            parts = centre.likelihood.parts
            names = parts_without_effect(self.nominal.robot, parts, asked)
            found = max((with_far_part(centre.fit, part.name, k) for k, part in enumerate(parts)
                         if part.name in names), key=self.score)
            if self.score(found) > best - self.score_margin(found, centre, -np.log(MIN_RELATIVE_PROBABILITY)):
                may_lead.append(found)
        self._refine_each(may_lead)


def remaining_torque_shares(fit: Fit) -> tuple[float, float]:
    """
    Return how large the torques are to which errors of joints are due, shares as in Amplitude.

    Errors so many times those stated are torques so many times those stated: slow ones. Were the
    sensor's noise as many times larger, it would hide what is fast and well known.
    """
    first, second = np.multiply(fit.discrepancy.torque_share, np.maximum(fit.error_scale[:2], 1.0))
    return float(first), float(second)
