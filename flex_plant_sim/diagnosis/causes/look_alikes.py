"""
The search step that asks whether the fault of a part is another one, or another size, beside laws.

Where a part seems to have one fault, it may have another instead: a late gauge may be a slow one.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import replace

from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.free_run_ranking import free_run_log_likelihoods
from flex_plant_sim.diagnosis.causes.hypothesis import Hypothesis
from flex_plant_sim.diagnosis.causes.neighbours import coarse_fits_of_each
from flex_plant_sim.diagnosis.causes.proposal_step import proposals_beside
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.causes.refinement import MAX_REFINED_AT_ONCE
from flex_plant_sim.diagnosis.causes.search_state import SearchState
import numpy as np

# Where a cause is a fault: its site and the family of its effect.
FaultPlace = tuple[str, str]


def refined_look_alikes(state: SearchState, with_laws: RefinedFit, asked: Container[FaultPlace]
                        ) -> list[RefinedFit]:
    """
    Return refined sets with laws in which a cause is replaced by one of its family at its site.

    That may be the cause itself from another start. Parts of which this was asked are left out.
    One step ahead neither a set nor its values are judged well beside laws, see
    `free_run_ranking`: of the optima found from each probed start, those with the best free runs
    are refined. (A slow gauge of the measured arm has optima at 16 ms, which evidence likes, and
    at 107 ms, whose free runs are 12 nats likelier.)
    """
    sets = look_alikes(state, with_laws, asked)
    found = coarse_fits_of_each(state, with_laws, sets, 'look-alikes beside laws')
    fits = different_optima(sorted(found, key=state.score, reverse=True))
    runs = free_run_log_likelihoods(
        [replace(with_laws, fit=fit) for fit in fits], state.data, state.nominal, state.jobs,
        lambda share: state.progress('free runs of look-alikes', 0.9 + 0.05 * share))
    best_first = [fits[index] for index in np.argsort(-runs) if np.isfinite(runs[index])]
    return state.refined_each(best_first[:MAX_REFINED_AT_ONCE])


def look_alikes(state: SearchState, centre: RefinedFit, asked: Container[FaultPlace]
                ) -> list[CandidateSet]:
    """Return the sets in which a cause is replaced by a fault of its part, from each start."""
    now = CandidateSet.of(centre.fit)
    return [candidate for index, cause in enumerate(now.hypotheses)
            if part_of(cause) not in asked
            for proposal in proposals_beside(state, centre, index)
            if part_of(proposal.hypothesis) == part_of(cause)
            for candidate in now.without(index).with_each_probe(proposal)]


def part_of(cause: Hypothesis) -> FaultPlace:
    """Return in which part a cause is a fault."""
    return cause.site, cause.effect.family


def different_optima(fits: Sequence[Fit]) -> list[Fit]:
    """Return fits without those within a deviation of one before them, of the same causes."""
    kept = list[Fit]()
    for fit in fits:
        if not any(_is_same_optimum(fit, other) for other in kept):
            kept.append(fit)
    return kept


def _is_same_optimum(fit: Fit, other: Fit) -> bool:
    if fit.hypotheses != other.hypotheses:
        return False
    step, k = fit.values - other.values, fit.values.size
    return float(step @ np.linalg.solve(other.covariance[:k, :k], step)) < 1.0
