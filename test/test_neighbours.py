"""Which neighbours of a set are fitted to all windows."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

from flex_plant_sim.diagnosis.causes import neighbours
from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses
from flex_plant_sim.diagnosis.causes.posterior import SetKey
from flex_plant_sim.diagnosis.causes.proposal_step import probe_catalogue
from flex_plant_sim.diagnosis.causes.refinement import refine_without_null_causes
from flex_plant_sim.diagnosis.causes.search_state import SearchState
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.effects import catalogue
import numpy as np
import pytest
from simulated_records import effects, REFERENCE, simulated, SLOWEST
from test_posterior import NOTHING

NAMES = ('strain_filter:arm', 'loose_payload:arm', 'base_compliance:arm')


def with_score(fit: Fit, score: float) -> Fit:
    """Return a fit with a score."""
    return replace(fit, log_evidence=score)


@pytest.mark.parametrize('delivered, expected', [
    (95.0, ['strain_filter:arm']),
    # What the leader does not deliver, the others may.
    (-5.0, ['strain_filter:arm', 'loose_payload:arm'])])
def test_others_are_fitted_where_the_leader_does_not_keep_its_promise(
        monkeypatch: pytest.MonkeyPatch, delivered: float, expected: list[str]) -> None:
    known = {h.label: h for h in all_hypotheses(REFERENCE)}
    coarse = [NOTHING, *(with_score(replace(NOTHING, hypotheses=(known[name],)), promise)
                         for name, promise in zip(NAMES, (100.0, 20.0, -60.0)))]
    gains = dict(zip(NAMES, (delivered, 15.0, 0.0)))
    state: Any = SimpleNamespace(score=lambda fit: fit.log_evidence, refined={})
    centre: Any = SimpleNamespace(fit=with_score(NOTHING, 7.0))
    fitted: list[str] = []

    def on_all_windows(state: Any, centre: Any, fits: list[Fit], step: str) -> list[Fit]:
        labels = [next(iter(SetKey.of(fit).labels)) for fit in fits]
        fitted.extend(labels)
        return [with_score(fit, 7.0 + gains[label]) for fit, label in zip(fits, labels)]

    monkeypatch.setattr(neighbours, '_fitted', on_all_windows)
    found = neighbours._fitted_as_promised(state, centre, [with_score(coarse[0], 0.0),
                                                           *coarse[1:]], 'step')
    assert fitted == expected and len(found) == len(expected)


def test_larger_sets_leave_room_for_what_may_stand_in_the_place_of_a_cause(
        monkeypatch: pytest.MonkeyPatch) -> None:
    clamp, gear, *others = (h for h in all_hypotheses(REFERENCE) if h.label in (
        'clamp_compliance:link_1', 'gear_compliance:joint_1') or h.effect.family == 'sensors')
    centre = replace(NOTHING, hypotheses=(clamp,))
    larger = [with_score(replace(NOTHING, hypotheses=(clamp, h)), -float(k))
              for k, h in enumerate({h.label: h for h in others}.values())]
    instead = with_score(replace(NOTHING, hypotheses=(gear,)), -20.0)
    assert len(larger) > 2 * neighbours.MAX_FITTED

    monkeypatch.setattr(neighbours, '_fitted', lambda state, centre, fits, step: fits)
    state: Any = SimpleNamespace(score=lambda fit: fit.log_evidence, refined={})
    found = neighbours._fitted_as_promised(
        state, cast(Any, SimpleNamespace(fit=with_score(centre, 0.0))),
        [with_score(centre, 0.0), *larger, instead], 'step')
    assert instead in found and len(found) == neighbours.MAX_FITTED + 1


def test_look_alikes_of_one_cause_leave_room_for_those_of_another(
        monkeypatch: pytest.MonkeyPatch) -> None:
    """Four frictions had the place of a slow gauge, so that its delay was told at 0.83."""
    known = {h.label: h for h in all_hypotheses(REFERENCE)}
    friction, delay, slow = (known[name] for name in (
        'coulomb_friction:joint_2', 'strain_delay:arm', 'strain_filter:arm'))
    others = [known[f'{name}_friction:joint_2'] for name in (
        'presliding', 'asymmetric', 'stribeck', 'viscous')]
    centre, *frictions, instead = (
        with_score(replace(NOTHING, hypotheses=found), -float(k)) for k, found in enumerate(
            [(friction, delay), *((delay, other) for other in others), (friction, slow)]))
    monkeypatch.setattr(neighbours, '_fitted', lambda state, centre, fits, step: fits)
    state: Any = SimpleNamespace(score=lambda fit: fit.log_evidence, refined={})
    found = neighbours._fitted_as_promised(
        state, cast(Any, SimpleNamespace(fit=centre)), [centre, *frictions, instead], 'step')
    assert found == [*frictions[:neighbours.MAX_WITHOUT], instead]


def test_an_effect_of_the_file_at_one_site_is_still_sought_at_others() -> None:
    nominal = BaseModel(REFERENCE, effects=effects('coulomb_friction:joint_2:level_n_m=0.05'))
    labels = {h.label for h in SearchState(cast(Any, None), nominal, 1, (),
                                           lambda label, share: None).catalogue}
    assert 'coulomb_friction:joint_1' in labels and 'coulomb_friction:joint_2' not in labels


def test_a_cause_that_is_far_from_its_null_is_refined_alone() -> None:
    # A payload 0.3 m beyond the tip, of a link of 0.5 m: from its probes a fit has to go far.
    asked = ('payload_offset', 'strain_gain')
    others = [name for name in catalogue() if name not in asked]
    far = effects('payload_offset:arm:offset_m=0.3')
    data = Data.of([simulated(far, 14.0)], SLOWEST, REFERENCE.sample_time)
    state = SearchState(data, BaseModel(REFERENCE), 1, others, lambda *told: None)
    nothing = state.refine(CandidateSet((), (np.zeros(0),)), BaseModel(REFERENCE).discrepancy)
    probe_catalogue(state, nothing)
    neighbours.refine_each_alone(state, nothing)
    # Gauges' gains do not replace the plant: fits around nothing are as good.
    assert {tuple(key.labels) for key in state.refined} == {(), ('payload_offset:arm',)}
    assert state.best.fit.values == pytest.approx([0.3], abs=0.01)


def test_a_set_that_ended_in_a_poor_optimum_is_refined_from_where_a_larger_one_ended() -> None:
    # Beside a base that slides, a filter of 0.000 s gained 3 nats, 5 less than the base alone.
    data = Data.of([simulated(effects('viscous_friction:joint_2:damping_n_m_s=3'), 14.0)], SLOWEST,
                   REFERENCE.sample_time)
    others = [name for name in catalogue() if name not in ('viscous_friction', 'strain_gain')]
    nominal = BaseModel(REFERENCE)
    state = SearchState(data, nominal, 1, others, lambda *told: None)
    friction, gain = (next(h for h in state.catalogue if h.label == label) for label in (
        'viscous_friction:joint_2', 'strain_gain:strain_2a'))
    alone, phantom, _ = (
        state.refine(CandidateSet(causes, (np.concatenate([np.zeros(0), *(
            np.array(h.null) for h in causes)]),)), nominal.discrepancy)
        for causes in ((friction,), (gain,), (friction, gain)))
    poor = replace(alone, fit=with_score(alone.fit, alone.fit.log_evidence - 8.0))
    key = SetKey.of(poor.fit)
    state.fits[key], state.refined[key] = poor.fit, poor
    assert SetKey.of(state.best.fit).labels == {friction.label, gain.label}
    refine_without_null_causes(state)
    assert state.best.fit.log_evidence > alone.fit.log_evidence - 0.3
    assert SetKey.of(state.best.fit) == key
    # The friction is not null.
    assert state.refined[SetKey.of(phantom.fit)] is phantom
