"""The search for sets of causes: add, exchange, drop until the evidence stops rising."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.posterior import (
    interpretations,
    leaves_strain_unexplained,
    ORDINARY_FAULTS,
    Posterior,
    SetKey,
)
from flex_plant_sim.diagnosis.causes.proposal import Proposal, ProposalRefiner
from flex_plant_sim.diagnosis.causes.refined_fit import CandidateSet, RefinedFit
from flex_plant_sim.diagnosis.causes.search_state import Progress, SearchState
from flex_plant_sim.diagnosis.causes.sensitivity import SensitivityProbe
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.record.data import Data
import numpy as np

# A budget, no judgement: sets whose neighbours are fitted.
MAX_CENTRES = 5


@dataclass(frozen=True)
class SearchResult:
    """
    Where a search ended.

    Attributes
    ----------
    best : Settled
        The most probable set.
    promises : tuple of Promise
        What each further hypothesis promised beside it.
    closer : Closer
        Looks at any of them again.
    posterior : Posterior
        Over all sets that were fitted.
    nothing : Fit
        The nominal model with its parts re-estimated.
    sizes : tuple of int
        Of the set that each round started from.

    """

    best: RefinedFit
    proposals: tuple[Proposal, ...]
    refiner: ProposalRefiner
    posterior: Posterior
    nothing: Fit
    round_sizes: tuple[int, ...]


def search(data: Data, nominal: BaseModel, jobs: int, progress: Progress,
           exclude: Sequence[str] = ()) -> SearchResult:
    """
    Return where a search among sets of causes ends.

    Where gauges err by more than every model may, what is unmodelled is no small part of the
    strain, and a hypothesis's sensors see it like the rest: then it is searched again so, and as
    soon as no set of as many causes as are ordinary does without.

    Parameters
    ----------
    data : Data
        The records.
    nominal : Base
        The model in question.
    jobs : int
        Processes.
    progress : Callable
        Told a step's name and its share done.
    exclude : sequence of str
        Identifiers to leave out of the catalogue.

    """
    state = SearchState(data, nominal, jobs, exclude, progress)
    while (found := _search_once(state)) is None:
        state = state.with_discrepancy_behind_sensors()
    return found


def _search_once(state: SearchState) -> SearchResult | None:
    """
    Return where one search ends; None where it is to begin anew, see `search`.

    The most probable set is linearised around itself and its neighbours are fitted, until the
    most probable set is one whose neighbours are known.
    """
    nominal, progress = state.nominal, state.progress
    progress('nothing', 0.0)
    nothing = state.refine(CandidateSet((), (np.zeros(0),), state.start_deviations), nominal.discrepancy)
    best = nothing.near_file_parts(nominal, state.data, state.jobs)
    if not state.sensitivities:
        state.probe(best)
    proposals = {SetKey.of(nothing.fit): state.fit_neighbours(best)}
    while len(proposals) < MAX_CENTRES:
        state.refine_leading(best)
        state.try_laws(best)
        # What was fitted around another set and turns out worse around itself has fallen back.
        best = state.best
        if SetKey.of(best.fit) in proposals:
            state.refine_alternatives(best, nothing)
            best = state.best
        if SetKey.of(best.fit) in proposals:
            progress('unknown', 0.9)
            state.try_far_parts()
            state.refine_leading(best)
            best = state.best
        if SetKey.of(best.fit) in proposals:
            break
        likeliest = max(interpretations(best.fit), key=state.score)
        if len(best.fit.hypotheses) >= ORDINARY_FAULTS and leaves_strain_unexplained(likeliest):
            return None
        proposals[SetKey.of(best.fit)] = state.fit_neighbours(best)
    else:
        state.try_far_parts()
        state.refine_leading(best)
    last = max((state.refined[key] for key in proposals), key=lambda c: state.score(c.fit))
    last_proposals = proposals[SetKey.of(last.fit)]
    posterior = state.posterior(last, last_proposals)
    if leaves_strain_unexplained(posterior.best):
        return None
    best = state.refined.get(SetKey.of(posterior.best).without_remainder, last)
    refiner = ProposalRefiner(SensitivityProbe(state.thinned, state.data.duration), state.proposal_scorer(last))
    return SearchResult(replace(best, fit=posterior.best), tuple(last_proposals), refiner, posterior, nothing.fit,
                  tuple(len(key.labels) for key in proposals))
