"""
The search for sets of causes: add, exchange and drop causes until the evidence stops rising.

It turns the records and the nominal model into a posterior over sets of causes, which the verdict
reads. Steps: the set without causes is refined, the catalogue is probed; then, around the most
probable set, neighbours are proposed and fitted, and those that may lead are refined.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter

from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.free_run_ranking import (
    free_run_log_likelihoods,
    ranked_by_free_runs,
)
from flex_plant_sim.diagnosis.causes.information import InformationProbe
from flex_plant_sim.diagnosis.causes.look_alikes import FaultPlace, part_of, refined_look_alikes
from flex_plant_sim.diagnosis.causes.neighbourhood import Neighbourhood
from flex_plant_sim.diagnosis.causes.neighbours import (
    fit_in_place_of_law,
    fit_neighbours,
    refine_each_alone,
)
from flex_plant_sim.diagnosis.causes.posterior import Posterior, SetKey
from flex_plant_sim.diagnosis.causes.proposal import Proposal
from flex_plant_sim.diagnosis.causes.proposal_step import probe_catalogue, proposals_beside
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.causes.refinement import (
    refine_alternatives,
    refine_leading,
    refine_without_null_causes,
    try_far_parts,
    try_laws,
)
from flex_plant_sim.diagnosis.causes.search_state import (
    MIN_RELATIVE_PROBABILITY,
    Progress,
    SearchState,
)
from flex_plant_sim.diagnosis.likelihood.prior import ORDINARY_FAULTS
from flex_plant_sim.diagnosis.pool import attempt
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.record.data import Data
import numpy as np

# Sets whose neighbours are fitted at most; a budget.
MAX_CENTRES = 5


@dataclass(frozen=True)
class SearchResult:
    """
    Where a search ended.

    Attributes
    ----------
    best : RefinedFit
        The most probable set.
    proposals : tuple of Proposal
        Of all other hypotheses, beside the most probable set whose neighbours were fitted.
    information : InformationProbe
        On further causes of any size, beside the same set.
    posterior : Posterior
        Over all sets that were fitted.
    nothing : RefinedFit
        The nominal model with its parts re-estimated.

    """

    best: RefinedFit
    proposals: tuple[Proposal, ...]
    information: InformationProbe
    posterior: Posterior
    nothing: RefinedFit


def search(data: Data, nominal: BaseModel, jobs: int, progress: Progress,
           exclude: Sequence[str] = ()) -> SearchResult:
    """
    Return where a search among sets of causes ends.

    Around the most probable refined set, neighbours are fitted and the leading sets are refined,
    until the neighbours of the most probable set are known.

    Parameters
    ----------
    data : Data
        The records.
    nominal : BaseModel
        The model in question.
    jobs : int
        Processes.
    progress : Callable
        Called with a step's name and its share done.
    exclude : sequence of str
        Identifiers to leave out of the catalogue.

    """
    state = SearchState(data, nominal, jobs, exclude, progress)
    progress('nothing', 0.0)
    nothing = state.refine(CandidateSet((), (np.zeros(0),)), nominal.discrepancy)
    best = nothing.near_file_parts(nominal, data, jobs)
    probe_catalogue(state, best)
    return _result(state, nothing, _explored(state, nothing, best))


def _explored(state: SearchState, nothing: RefinedFit, best: RefinedFit
              ) -> dict[SetKey, Neighbourhood]:
    """Fit the neighbours of the most probable set until they are known; return those of each."""
    found = {SetKey.of(nothing.fit): fit_neighbours(state, best)}
    named: set[SetKey] = set()
    asked_where_parts_are = asked_alone = False
    while len(found) < MAX_CENTRES:
        refine_leading(state, best)
        try_laws(state, best)
        _name_laws(state, named)
        # A fit around another set may have been better than the refined one, which counts.
        best = state.best
        if _has_many_causes(best.fit) and not asked_alone:
            refine_each_alone(state, nothing)
            best, asked_alone = state.best, True
        if SetKey.of(best.fit) == SetKey.of(nothing.fit) and not asked_where_parts_are:
            # Around the file's parts, causes make up for parts before they stand for themselves.
            found[SetKey.of(best.fit)] = fit_neighbours(state, best)
            asked_where_parts_are = True
            continue
        if SetKey.of(best.fit) in found:
            refine_alternatives(state, best, nothing)
            refine_without_null_causes(state)
            best = state.best
        if SetKey.of(best.fit) in found:
            state.progress('unknown', 0.9)
            try_far_parts(state)
            refine_leading(state, best)
            best = state.best
        if SetKey.of(best.fit) in found or _is_complete(best.fit):
            return found
        found[SetKey.of(best.fit)] = fit_neighbours(state, best)
        if _parts_hide_a_cause(state, best):
            fit_neighbours(state, best.near_file_parts(state.nominal, state.data, state.jobs))
    try_far_parts(state)
    refine_leading(state, best)
    return found


def _parts_hide_a_cause(state: SearchState, centre: RefinedFit) -> bool:
    """
    Tell whether a centre's parts stand for a cause that none of its neighbours names.

    Beside something unnamed they stand for that.
    """
    return (centre.fit.discrepancy == state.nominal.discrepancy
            and centre.parts_stand_for_a_cause and state.best.parts_stand_for_a_cause)


def _result(state: SearchState, nothing: RefinedFit, explored: dict[SetKey, Neighbourhood]
            ) -> SearchResult:
    if state.best.fit.discrepancy.laws:
        return ranked_with_laws(state, nothing)
    last = max((state.refined[key] for key in explored), key=lambda r: state.score(r.fit))
    around = explored[SetKey.of(last.fit)]
    posterior = state.posterior(around.unfitted_scores(state), around.as_read(state),
                                parts_vary=True)
    best = state.refined.get(SetKey.of(posterior.best).without_remainder, last)
    return SearchResult(
        replace(best, fit=posterior.best), around.proposals,
        InformationProbe.beside(last), posterior, nothing)


def _name_laws(state: SearchState, named: set[SetKey]) -> None:
    """Fit causes in the place of laws until the best set has none, or no cause is better."""
    while (key := SetKey.of((best := state.best).fit)) not in named:
        named.add(key)
        for law in best.fit.discrepancy.laws:
            attempt(partial(fit_in_place_of_law, state, best), law)


def _has_many_causes(fit: Fit) -> bool:
    """Tell whether a set has more causes than are ordinary at once."""
    return len(fit.hypotheses) > ORDINARY_FAULTS


def _is_complete(fit: Fit) -> bool:
    """
    Tell whether a set needs no neighbours: laws of unknown torques beside ordinary faults.

    What a further cause gains one step ahead is then what the laws' tables round off.
    """
    return bool(fit.discrepancy.laws) and len(fit.hypotheses) >= ORDINARY_FAULTS


def ranked_with_laws(state: SearchState, nothing: RefinedFit) -> SearchResult:
    """
    Return where a search ends in which laws of unknown torques lead.

    Parameters
    ----------
    state : SearchState
        With sets with laws among those that are refined.
    nothing : RefinedFit
        The nominal model with its parts re-estimated.

    """
    found: dict[SetKey, tuple[RefinedFit, float]] = {}
    asked: set[FaultPlace] = set()
    fresh = state.refined_with_laws
    while True:
        runs = free_run_log_likelihoods(
            fresh, state.data, state.nominal, state.jobs,
            lambda share: state.progress('free runs beside laws', 0.9))
        for chosen, run in zip(fresh, runs):
            # Of a set that was refined from several starts, the one that runs best counts.
            key = SetKey.of(chosen.fit)
            found[key] = max((chosen, run), found.get(key, (chosen, -np.inf)), key=itemgetter(1))
        sets = [chosen for chosen, _ in found.values()]
        best, posterior = ranked_by_free_runs(
            sets, np.array([run for _, run in found.values()]), state.nominal)
        # Of every stated set, and of the likeliest with causes where laws alone are likelier yet.
        named = next((fit for fit, p in zip(posterior.fits, posterior.probability)
                      if (p > MIN_RELATIVE_PROBABILITY or not asked)
                      and not asked.issuperset(map(part_of, fit.hypotheses))), None)
        if named is None:
            break
        fresh = attempt(partial(refined_look_alikes, state, asked=frozenset(asked)),
                        found[SetKey.of(named)][0]) or []
        asked.update(map(part_of, named.hypotheses))
    return SearchResult(best, tuple(proposals_beside(state, best)),
                        InformationProbe.beside(best), posterior, nothing)
