"""Resonant causes that stand for one another beside a further cause."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.neighbours import unpromised
from flex_plant_sim.diagnosis.causes.proposal_step import probe_catalogue, proposals_beside
from flex_plant_sim.diagnosis.causes.search_state import SearchState
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.effects import catalogue
import numpy as np
from simulated_records import effects, REFERENCE, simulated, SLOWEST


def test_a_resonant_cause_is_tried_in_the_place_of_another_whatever_it_promises() -> None:
    """Beside a soft link a base gave way; a payload that swings was named, at 0.88."""
    hidden = effects('base_compliance:arm:compliance_rad_per_n_m=0.002,inertia_kg_m2=0.2',
                     'link_stiffness:link_1:factor=0.76')
    data = Data.of([simulated(hidden, 14.0)], SLOWEST, REFERENCE.sample_time)
    asked, base = ('base_compliance', 'loose_payload', 'link_stiffness'), BaseModel(REFERENCE)
    state = SearchState(data, base, 1, [name for name in catalogue() if name not in asked],
                        lambda *told: None)
    nothing = state.refine(CandidateSet((), (np.zeros(0),)), base.discrepancy)
    probe_catalogue(state, nothing)
    known = {h.label: h for h in reversed(state.catalogue)}
    loose, soft = known['loose_payload:arm'], known['link_stiffness:link_1']
    swinging = loose.null + 0.01 * loose.is_size
    centre = state.refine(CandidateSet((loose, soft), (np.append(swinging, 0.75),)),
                          base.discrepancy)
    hopeless = [[replace(p, linear_gain=-9.0) for p in proposals_beside(state, centre, k)]
                for k in range(2)]
    found = unpromised(state, centre, [], hopeless, 'again')
    assert {'base_compliance:arm', soft.label} in [
        {h.label for h in candidate.hypotheses} for candidate in found]
    # With one cause, the others were tried beside nothing.
    alone = state.refine(CandidateSet((loose,), (swinging,)), base.discrepancy)
    assert not unpromised(state, alone, [], hopeless[1:], 'again')


def test_a_gap_beside_a_cause_is_fitted_from_its_probed_sizes_too() -> None:
    """Its sensitivities beside no cause lead back to no gap."""
    hidden = effects('backlash:joint_2:gap_rad=0.003,sensor_behind_gear=0,hub_share=0.1',
                     'payload_mass:arm:deviation_kg=-0.05')
    data = Data.of([simulated(hidden, 14.0)], SLOWEST, REFERENCE.sample_time)
    asked, base = ('backlash', 'payload_mass'), BaseModel(REFERENCE)
    state = SearchState(data, base, 1, [name for name in catalogue() if name not in asked],
                        lambda *told: None)
    nothing = state.refine(CandidateSet((), (np.zeros(0),)), base.discrepancy)
    probe_catalogue(state, nothing)
    light, = (h for h in state.catalogue if h.label == 'payload_mass:arm')
    centre = state.refine(CandidateSet((light,), (np.array([-0.05]),)), base.discrepancy)
    hopeless = [replace(p, linear_gain=-9.0, starts=(p.hypothesis.null,))
                for p in proposals_beside(state, centre)]
    sizes = [candidate.starts[0][1] for candidate in unpromised(state, centre, hopeless, [], '')
             if 'backlash:joint_2' in candidate.labels]
    assert sizes and max(sizes) > 0.002
