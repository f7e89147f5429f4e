"""Other faults of a part, and other sizes of its fault, which free runs choose between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.look_alikes import look_alikes, part_of
from flex_plant_sim.diagnosis.causes.proposal_step import probe_catalogue
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.causes.search import ranked_with_laws
from flex_plant_sim.diagnosis.causes.search_state import SearchState
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.effects import catalogue
from flex_plant_sim.effects.joint.measured_torque import MeasuredTorque
import numpy as np
import pytest
from simulated_records import effects, REFERENCE, simulated, SLOWEST


def begun() -> tuple[SearchState, RefinedFit]:
    """Return a search among three effects on an arm with two of them, and nothing refined."""
    hidden = effects('strain_filter:arm:time_constant_s=0.05,damping=0.7',
                     'viscous_friction:joint_1:damping_n_m_s=2')
    data, base = Data.of([simulated(hidden, 14.0)], SLOWEST, REFERENCE.sample_time), BaseModel(
        REFERENCE)
    asked = ('strain_filter', 'strain_delay', 'viscous_friction')
    state = SearchState(data, base, 1, [name for name in catalogue() if name not in asked],
                        lambda *told: None)
    nothing = state.refine(CandidateSet((), (np.zeros(0),)), base.discrepancy)
    probe_catalogue(state, nothing)
    return state, nothing


def test_a_fault_is_its_own_look_alike_from_other_starts() -> None:
    """Evidence likes the measured arm's filter at 16 to 24 ms, free runs at 107 ms."""
    state, nothing = begun()
    known = {h.label: h for h in state.catalogue}
    causes = known['strain_filter:arm'], known['viscous_friction:joint_1']
    centre = state.refine(CandidateSet(causes, (np.array([0.02, 2.0, 2.0]),)),
                          nothing.fit.discrepancy)
    of_gauges = part_of(causes[0])
    starts: dict[str, set[float]] = {}
    for found in look_alikes(state, centre, {part_of(causes[1])}):
        assert found.hypotheses[0] == causes[1], 'what was asked stays'
        starts.setdefault(found.hypotheses[1].label, set()).add(found.starts[0][1])
        assert part_of(found.hypotheses[1]) == of_gauges
    assert set(starts) == {'strain_filter:arm', 'strain_delay:arm'}
    assert max(starts['strain_filter:arm']) > 3.0 * min(starts['strain_filter:arm'])
    assert not look_alikes(state, centre, {part_of(cause) for cause in causes})


@pytest.mark.parametrize('better', [False, True])
def test_where_laws_alone_lead_the_likeliest_set_with_causes_is_asked(
        better: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """On the measured arm, the filter's other optimum runs better than laws alone."""
    state, nothing = begun()
    law = MeasuredTorque('joint_1', ('speed', (-1.0, 0.0, 1.0), (-2.0, 0.0, 2.0)))
    laws = replace(nothing.fit.discrepancy, laws=(law,), law_penalties=(9.0,))
    slow, weak = (next(h for h in state.catalogue if h.label == label)
                  for label in ('strain_filter:arm', 'viscous_friction:joint_1'))
    alone = state.refine(CandidateSet((), (np.zeros(0),)), laws)
    named = state.refine(CandidateSet((slow,), (np.array([0.02, 0.7]),)), laws)
    state.refine(CandidateSet((weak,), (np.array([0.1]),)), laws)
    other = replace(named, fit=replace(named.fit, values=np.array([0.1, 0.7])))
    runs = {(): 100.0, tuple(named.fit.values): 50.0, tuple(other.fit.values): 200.0}
    around = list[RefinedFit]()

    def scores(sets: Sequence[RefinedFit], *rest: Any) -> np.ndarray:
        return np.array([runs.get(tuple(chosen.fit.values), 0.0) for chosen in sets])

    def others(state: SearchState, with_laws: RefinedFit, asked: Any) -> list[RefinedFit]:
        around.append(with_laws)
        return [other] * better

    module = 'flex_plant_sim.diagnosis.causes.search'
    monkeypatch.setattr(f'{module}.free_run_log_likelihoods', scores)
    monkeypatch.setattr(f'{module}.refined_look_alikes', others)
    best = ranked_with_laws(state, nothing).best
    # Once its part was asked, what is far behind is not stated, and asked no more.
    assert [chosen.fit.hypotheses for chosen in around] == [(slow,)]
    np.testing.assert_array_equal(best.fit.values, (other if better else alone).fit.values)
