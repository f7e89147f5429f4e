"""
The search step that proposes causes: sensitivities once, then proposals beside any set of causes.

Proposals and coarse fits use the innovations of each arm's own filter: these have fewer local
minima, and large errors of one channel do not mask the others. Evidence does not use them.
"""

from __future__ import annotations

from flex_plant_sim.diagnosis.causes.proposal import Proposal, ProposalScorer
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.causes.search_state import SearchState
from flex_plant_sim.diagnosis.causes.sensitivity import SensitivityProbe
from flex_plant_sim.diagnosis.likelihood.sufficient_statistics import TEMPER
from flex_plant_sim.diagnosis.pool import each
import numpy as np


def probe_catalogue(state: SearchState, nothing: RefinedFit) -> None:
    """Take the sensitivities of all hypotheses, beside no cause."""
    state.thinned = nothing.coarse.likelihood
    state.sensitivities = each(
        SensitivityProbe(state.thinned), state.catalogue, state.jobs,
        lambda share: state.progress('looking at all causes', 0.4 * share))
    state.resonant = frozenset(
        h.label for h, sensitivities in state.sensitivities
        if any(state.thinned.has_new_coordinates((h.effect_at(some.shape + some.deviation),))
               for some in sensitivities))


def proposal_scorer(state: SearchState, centre: RefinedFit, left_out: int | None = None
                    ) -> ProposalScorer:
    """Return the scorer of proposals beside a set, or beside it without one of its causes."""
    centre = centre.coarse
    fit, likelihood = centre.fit, centre.likelihood
    kept = np.ones(len(fit.values), dtype=bool)
    residual, boundaries = centre.point.residual, centre.causes.boundaries
    if left_out is not None:
        kept[boundaries[left_out]:boundaries[left_out + 1]] = False
        effects = centre.causes.effects(fit.values)
        residual = likelihood.residual(effects[:left_out] + effects[left_out + 1:])[0]
    jacobian = centre.point.jacobian[kept]
    at_centre = residual - np.tensordot(fit.statistics.offsets[kept], jacobian, 1)
    rows = np.concatenate([at_centre[None], jacobian, likelihood.part_jacobian])
    weight = np.repeat(1.0 / (fit.error_scale * np.sqrt(TEMPER)), rows.shape[-1])
    return ProposalScorer(
        rows.reshape(len(rows), -1) * weight,
        np.concatenate([fit.statistics.widths[kept], likelihood.tolerances]), weight,
        state.data.duration)


def proposals_beside(state: SearchState, centre: RefinedFit, left_out: int | None = None
                     ) -> list[Proposal]:
    """Return proposals of all other hypotheses, see `proposal_scorer`, the best first."""
    scorer, hypotheses = proposal_scorer(state, centre, left_out), centre.fit.hypotheses
    labels = {h.label for k, h in enumerate(hypotheses) if k != left_out}
    others = [known for known in state.sensitivities if known[0].label not in labels]
    found = each(lambda known: scorer.propose(*known), others, state.jobs)
    return sorted(found, key=lambda p: -state.penalised_gain(p))
