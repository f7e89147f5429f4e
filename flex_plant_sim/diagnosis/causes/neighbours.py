"""
The search step that fits the neighbours of a set: one cause more, one less, or one exchanged.

Neighbours are fitted coarsely first, on some windows. The best of them are fitted to all windows
around the linearisation of the set; `refinement` then linearises those that may lead.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.event_time import FIRST_EVENT_TIMES
from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.gauss_newton import fit_set
from flex_plant_sim.diagnosis.causes.hypothesis import CauseSet
from flex_plant_sim.diagnosis.causes.neighbourhood import Neighbourhood
from flex_plant_sim.diagnosis.causes.part_causes import fits_replacing_parts
from flex_plant_sim.diagnosis.causes.posterior import SetKey
from flex_plant_sim.diagnosis.causes.proposal import Proposal
from flex_plant_sim.diagnosis.causes.proposal_step import proposals_beside
from flex_plant_sim.diagnosis.causes.refined_fit import (
    GAIN_UNCERTAINTY,
    LINEARISATION_ERROR,
    RefinedFit,
)
from flex_plant_sim.diagnosis.causes.refinement import MAX_REFINED_AT_ONCE, refine_contenders
from flex_plant_sim.diagnosis.causes.search_state import MAX_ADDED, SearchState
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.pool import each
from flex_plant_sim.effects.base import Effect
import numpy as np

# Budgets: sets fitted to all windows beside a law; neighbours fitted to all windows, by kind. A
# set with a cause more has all of what others have, so that many of these would leave no room for
# those without a certain cause.
MAX_FITTED = 6
MAX_NEIGHBOURS, MAX_WITHOUT = {'larger': MAX_FITTED, 'refined': 1}, 3
# Score by which a coarse fit may be behind the best one and yet be fitted to all windows, nats.
MAX_COARSE_DEFICIT = 30.0
# Share of a cause's gain that a proposal needs to be an alternative to it. (Without it, answers to
# the bench's records are the same and take 1.11 times as long.)
MIN_ALTERNATIVE_SHARE = 0.3


@dataclass(frozen=True)
class NeighbourFitter:
    """
    Fits sets around the linearisation of one near them.

    Where a set has coordinates that the trajectory there lacks, it is fitted once more along its
    own trajectory, with the same Jacobian in the parts; coarsely, from its best start alone. Where
    it lacks one of their causes and changes the robot itself, the better of both fits counts: the
    Jacobian may suit neither.

    Attributes
    ----------
    likelihood : Likelihood
        Linearised around the set near them.
    error_scale : Array
        Factor of the errors over what the filter states, (m,).
    duration : float
        Of the longest record, s.
    coarse : bool
        Whether fits only rank sets.

    """

    likelihood: Likelihood
    error_scale: Array
    duration: float
    coarse: bool = False

    def __call__(self, candidate: CandidateSet) -> Fit:
        causes = CauseSet(candidate.hypotheses, self.duration)
        fit = fit_set(self.likelihood, causes, candidate.starts, self.error_scale, self.coarse)
        return fit if self.coarse else self.along_own_trajectory(fit)

    def along_own_trajectory(self, fit: Fit) -> Fit:
        """Return a fit made once more along its trajectory, if it is another arm's."""
        causes = CauseSet(fit.hypotheses, self.duration)
        effects = causes.effects(fit.values)
        new_coordinates = self.likelihood.has_new_coordinates(effects)
        if not new_coordinates and not self._replaces_the_robot(fit, effects):
            return fit
        own = fit_set(self.likelihood.along_trajectory_of(effects), causes, (fit.values,),
                      self.error_scale, self.coarse)
        return own if new_coordinates else max(fit, own, key=lambda found: found.log_evidence)

    def _replaces_the_robot(self, fit: Fit, effects: Sequence[Effect]) -> bool:
        """Tell whether a fit lacks a cause of the centre and changes the robot itself."""
        labels = {h.label for h in fit.hypotheses}
        return (any(type(effect).on_robot is not Effect.on_robot for effect in effects)
                and any(f'{effect.identifier}:{effect.site}' not in labels
                        for effect in self.likelihood.centre_effects))


def fit_neighbours(state: SearchState, centre: RefinedFit) -> Neighbourhood:
    """Fit the neighbours of a set and refine those that may lead."""
    key, step = SetKey.of(centre.fit), f'cause {len(centre.fit.hypotheses) + 1}'
    proposals = proposals_beside(state, centre)
    in_place = [proposals_beside(state, centre, k) for k in range(len(centre.fit.hypotheses))]
    sets = list(candidates(state, centre, proposals, in_place))
    sets += unpromised(state, centre, proposals, in_place, step)
    state.coarse_fits[key] = _coarse_fits(state, centre, sets, step)
    fits = _fitted_as_promised(state, centre, state.coarse_fits[key], step)
    replacing = tuple(fits_replacing_parts(state.refined[key], state.catalogue))
    _keep_better(state, [*fits, *replacing])
    refine_contenders(state, replacing, state.posterior().best, centre)
    return Neighbourhood(centre.fit, tuple(proposals))


def fit_in_place_of_law(state: SearchState, with_laws: RefinedFit, law: Effect) -> None:
    """
    Fit causes at a joint in the place of a law of its unnamed torque; refine those that may lead.

    Beside no law, a cause may hide behind parts that imitate it and what is wrong besides; beside
    its law, parts and other causes are known as they are without it.
    """
    discrepancy = with_laws.fit.discrepancy.without_law(law)
    centre = with_laws.beside(replace(state.nominal, discrepancy=discrepancy), state.data,
                              state.jobs)
    now, step = CandidateSet.of(with_laws.fit), f'causes in the place of a law of {law.site}'
    at_joint = [p for p in proposals_beside(state, centre) if p.hypothesis.site == law.site]
    sets = [now, *(now.with_proposal(p) for p in _deserving(state, at_joint))]
    explained = max(map(state.score, _coarse_fits(state, with_laws, [now], step)), default=-np.inf)
    coarse = sorted(_coarse_fits(state, centre, sets, step), key=lambda fit: -state.score(fit))
    unexplained = max((state.score(fit) for fit in coarse if fit.hypotheses == now.hypotheses),
                      default=-np.inf)
    least = explained - max(GAIN_UNCERTAINTY * (explained - unexplained), MAX_COARSE_DEFICIT)
    near = [fit for fit in coarse if state.score(fit) > least]
    _keep_better(state, _fitted(state, centre, near[:MAX_FITTED], step))
    leading = state.posterior().fits[:MAX_REFINED_AT_ONCE]
    refine_contenders(state, leading, leading[0], with_laws)


def refine_each_alone(state: SearchState, nothing: RefinedFit) -> None:
    """
    Refine each cause that replaces the plant alone, from its best probe, if it promises anything.

    Many causes at once are rare, and one that is far from its null may be behind them all. From
    so far off neither a linear gain nor a fit with the nominal arm's filter tells which. (A
    payload 0.24 m beyond the tip of a link of 0.2 m was 21st by its promise; three causes that
    stood for it had 36 nats less.)
    """
    none = CandidateSet.of(nothing.fit)
    promising = [p for p in proposals_beside(state, nothing)
                 if p.hypothesis.effect.structural and state.promises_gain(p)]
    best = {p.hypothesis.label: none.with_proposal(p) for p in reversed(promising)}
    refined = {key.labels for key in state.refined}
    state.refine_to_the_end([alone for label, alone in best.items() if {label} not in refined])


def _keep_better(state: SearchState, fits: Iterable[Fit]) -> None:
    """Keep each fit unless its set is refined and not clearly worse."""
    for fit in fits:
        key = SetKey.of(fit)
        known = state.fits.get(key, fit)
        if key not in state.refined or state.score(fit) > state.score(known) + LINEARISATION_ERROR:
            state.fits[key] = fit


def candidates(state: SearchState, centre: RefinedFit, proposals: Sequence[Proposal],
               in_place: Sequence[Sequence[Proposal]]) -> Iterator[CandidateSet]:
    """
    Yield a set and its neighbours that deserve a coarse fit.

    Proposals are those beside the set, and in the place of each of its causes.
    """
    now = CandidateSet.of(centre.fit)
    yield now
    for proposal in _deserving(state, proposals):
        yield from _extended(state, now, proposal)
    for index, (cause, others) in enumerate(zip(now.hypotheses, in_place)):
        rest = now.without(index)
        yield rest
        own = max((state.penalised_gain(p) for p in others if p.hypothesis == cause), default=0.0)
        alternatives = [p for p in others if p.hypothesis != cause
                        and state.penalised_gain(p) > MIN_ALTERNATIVE_SHARE * own]
        for proposal in alternatives[:MAX_ADDED]:
            yield from _extended(state, rest, proposal)


def unpromised(state: SearchState, centre: RefinedFit, proposals: Sequence[Proposal],
               in_place: Sequence[Sequence[Proposal]], step: str) -> list[CandidateSet]:
    """
    Return the sets with a resonant cause that gains when it is fitted, though it promises nothing.

    Between two probed sizes such a cause may gain much. (A gap of 0.56 mrad promised -8 nats, and
    had 113 when it was fitted.) In the place of another resonant cause of several it may gain as
    much as that. (Beside a soft link, a base that gives way promised -3.5 nats, and had 17, one
    more than a payload that swings.)

    Its sensitivities are those beside no cause. Beside one, teeth part and meet at other times, so
    that it is fitted from the best of its probed values too. (Beside a payload that is 50 g off, a
    gap of 3 mrad promised -10 nats and led back to none; from a probe it had 55.)
    """
    now, several = CandidateSet.of(centre.fit), len(centre.fit.hypotheses) > 1
    rests = [(now, proposals, 0.0), *(
        (now.without(index), others, MAX_COARSE_DEFICIT)
        for index, (cause, others) in enumerate(zip(now.hypotheses, in_place))
        if several and cause.label in state.resonant)]
    found = list[CandidateSet]()
    for rest, others, deficit in rests:
        from_probes = rest is now and len(now.hypotheses) > 0
        tried = [rest.with_proposal(replace(p, starts=starts)) for p in others
                 if p.hypothesis.label in state.resonant and p.hypothesis.is_fitted
                 and not state.promises_gain(p)
                 for starts in (p.starts, p.probe_starts if from_probes else ()) if starts]
        found += [CandidateSet.of(fit) for fit in _first_coarse_fits(state, centre, tried, step)
                  if state.score(fit) > state.score(centre.coarse.fit) - deficit]
    return found


def _deserving(state: SearchState, proposals: Sequence[Proposal]) -> Iterable[Proposal]:
    """Return the best proposal of each label and structure that deserves a coarse fit."""
    added = [p for rank, p in enumerate(proposals) if state.deserves_fit(rank, p)]
    return {(p.hypothesis.label, p.hypothesis.switches): p for p in reversed(added)}.values()


def _extended(state: SearchState, candidate: CandidateSet, proposal: Proposal
              ) -> Iterable[CandidateSet]:
    """Return a set with a proposed cause; if that is resonant, from each probed start."""
    if proposal.hypothesis.event_index is not None and state.penalised_gain(proposal) > 0.0:
        proposal = proposal.with_times_around(state.thinned.period)
    if proposal.hypothesis.label in state.resonant:
        return candidate.with_each_probe(proposal)
    return [candidate.with_proposal(proposal)]


def _coarse_fits(state: SearchState, centre: RefinedFit, sets: Iterable[CandidateSet],
                 step: str) -> list[Fit]:
    """Return coarse fits of sets around a centre, one of each set."""
    # Of a set that was fitted from several starts, the best fit comes last.
    best = {SetKey.of(fit): fit for fit in sorted(
        _first_coarse_fits(state, centre, sets, step), key=state.score)}
    return _along_own_trajectories(state, centre, list(best.values()), step)


def coarse_fits_of_each(state: SearchState, centre: RefinedFit, sets: Iterable[CandidateSet],
                        step: str) -> list[Fit]:
    """Return coarse fits around a centre, one of each set and start."""
    return _along_own_trajectories(
        state, centre, _first_coarse_fits(state, centre, sets, step), step)


def _coarse_fitter(state: SearchState, centre: RefinedFit) -> NeighbourFitter:
    return NeighbourFitter(centre.coarse.likelihood, centre.coarse.fit.error_scale,
                           state.data.duration, coarse=True)


def _first_coarse_fits(state: SearchState, centre: RefinedFit, sets: Iterable[CandidateSet],
                       step: str) -> list[Fit]:
    return each(_coarse_fitter(state, centre), list(sets), state.jobs,
                lambda share: state.progress(step, 0.4 + 0.2 * share))


def _along_own_trajectories(state: SearchState, centre: RefinedFit, fits: Sequence[Fit],
                            step: str) -> list[Fit]:
    return each(_coarse_fitter(state, centre).along_own_trajectory, fits, state.jobs,
                lambda share: state.progress(step, 0.6 + 0.1 * share))


def _fitted(state: SearchState, centre: RefinedFit, coarse: Sequence[Fit], step: str
            ) -> list[Fit]:
    """Return coarse fits fitted to all windows."""
    return each(NeighbourFitter(centre.likelihood, centre.fit.error_scale, state.data.duration),
                [with_event_times(CandidateSet.of(fit), centre) for fit in coarse],
                state.jobs,
                lambda share: state.progress(step, 0.7 + 0.2 * share))


def with_event_times(candidate: CandidateSet, centre: RefinedFit) -> CandidateSet:
    """
    Return a set with more starts, if it has an event: at times that coarse fits do not tell.

    They are those between the windows of coarse fits before and after the event's, as an event
    that no window saw is best at an end of one; and where the centre's event is.
    """
    time = candidate.event_time
    if time is None:
        return candidate
    seen, every = np.unique(centre.coarse.likelihood.times), centre.likelihood.times
    # Not by the sampling interval: stamps jitter, and records have their own.
    after_gap = np.flatnonzero(np.diff(seen) > 0.5 * centre.likelihood.period) + 1
    starts, ends = seen[np.r_[0, after_gap]], seen[np.r_[after_gap - 1, -1]]
    around = candidate.with_event_at(np.linspace(
        np.max(ends[ends < time], initial=np.min(every)),
        np.min(starts[starts > time], initial=np.max(every)), FIRST_EVENT_TIMES))
    has_event = any(h.event_index is not None for h in centre.fit.hypotheses)
    return around.with_values_of(CandidateSet.of(centre.fit)) if has_event else around


def _fitted_as_promised(state: SearchState, centre: RefinedFit, coarse: Sequence[Fit], step: str
                        ) -> list[Fit]:
    """
    Return neighbours fitted to all windows: those that promise nearly as much as the best gains.

    A coarse fit may promise what the set does not gain on all windows, so that what others promise
    is compared with what the best gained there, and they are fitted then.
    """
    at_centre = max((state.score(fit) for fit in coarse
                     if SetKey.of(fit) == SetKey.of(centre.fit)), default=-np.inf)
    promises = {SetKey.of(fit): state.score(fit) - at_centre for fit in coarse}
    left = sorted((fit for fit in coarse if SetKey.of(fit) != SetKey.of(centre.fit)),
                  key=lambda fit: -state.score(fit))
    spent, fitted = Counter[str](), list[Fit]()
    causes = SetKey.of(centre.fit).labels

    def kind(fit: Fit) -> str:
        if SetKey.of(fit) in state.refined:
            return 'refined'
        if len(fit.hypotheses) > len(causes):
            return 'larger'
        # One cause with many look-alikes would take the place of those of another.
        return ' '.join(sorted(causes - SetKey.of(fit).labels))

    while left:
        best = max((state.score(fit) - state.score(centre.fit) for fit in fitted),
                   default=promises[SetKey.of(left[0])])
        least = best - max(GAIN_UNCERTAINTY * best, MAX_COARSE_DEFICIT)
        near = [fit for fit in left if promises[SetKey.of(fit)] > least]
        chosen = list[Fit]()
        for fit in near:
            if spent[kind(fit)] < MAX_NEIGHBOURS.get(kind(fit), MAX_WITHOUT):
                spent[kind(fit)] += 1
                chosen.append(fit)
        if not chosen:
            break
        fitted += _fitted(state, centre, chosen, step)
        done = {SetKey.of(fit) for fit in chosen}
        left = [fit for fit in left if SetKey.of(fit) not in done]
    return fitted
