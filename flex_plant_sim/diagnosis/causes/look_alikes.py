"""
The search step that asks whether the fault of a part is another one, beside laws.

Where a part seems to have one fault, it may have another instead: a late gauge may be a slow one.
"""

from __future__ import annotations

from collections.abc import Sequence
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


def refined_look_alikes(state: SearchState, with_laws: RefinedFit) -> list[RefinedFit]:
    """
    Return refined sets with laws in which a cause is replaced by one of its family at its site.

    One step ahead neither a set nor its values are judged well beside laws, see
    `free_run_ranking`: of the optima found from each probed start, those with the best free runs
    are refined. (A slow gauge of the measured arm has optima at 16 ms, which evidence likes, and
    at 107 ms, whose free runs are 12 nats likelier.)
    """
    now = CandidateSet.of(with_laws.fit)
    sets = [candidate for index, cause in enumerate(now.hypotheses)
            for proposal in proposals_beside(state, with_laws, index)
            if is_look_alike(proposal.hypothesis, cause)
            for candidate in now.without(index).with_each_probe(proposal)]
    fits = coarse_fits_of_each(state, with_laws, sets, 'look-alikes beside laws')
    runs = free_run_log_likelihoods(
        [replace(with_laws, fit=fit) for fit in fits], state.data, state.nominal, state.jobs,
        lambda share: state.progress('free runs of look-alikes', 0.9 + 0.05 * share))
    best_first = [fits[index] for index in np.argsort(-runs) if np.isfinite(runs[index])]
    return state.refined_each(different_optima(best_first)[:MAX_REFINED_AT_ONCE])


def is_look_alike(hypothesis: Hypothesis, cause: Hypothesis) -> bool:
    """Tell whether a hypothesis is another fault of the part in which a cause is."""
    return (hypothesis.effect is not cause.effect and hypothesis.site == cause.site
            and hypothesis.effect.family == cause.effect.family)


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
