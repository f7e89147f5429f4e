"""Refined fits of one set of causes, and the neighbours of a set that are fitted."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.gauss_newton import fit_set, GaussNewton
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses, CauseSet
from flex_plant_sim.diagnosis.causes.neighbours import (
    candidates,
    fit_neighbours,
    NeighbourFitter,
    unpromised,
)
from flex_plant_sim.diagnosis.causes.part_causes import fits_replacing_parts
from flex_plant_sim.diagnosis.causes.posterior import SetKey
from flex_plant_sim.diagnosis.causes.proposal_step import probe_catalogue, proposals_beside
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.causes.search import _explored
from flex_plant_sim.diagnosis.causes.search_state import SearchState
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.prior import part_priors, with_deviations
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base, slowest_frequency
from flex_plant_sim.effects import catalogue
import numpy as np
import pytest
from simulated_records import effects, REFERENCE, simulated, SLOWEST
from truth.records import make_record, TruthCase
from truth.tolerances import TOLD


def test_a_look_alike_is_fitted_along_its_own_trajectory() -> None:
    clamp, base = effects('clamp_compliance:link_1:compliance_rad_per_n_m=0.01',
                          'base_compliance:arm:compliance_rad_per_n_m=0.009,inertia_kg_m2=0.05')
    data = Data.of([simulated((clamp,), 14.0)], SLOWEST, REFERENCE.sample_time)
    known = {h.label: h for h in all_hypotheses(REFERENCE)}
    near, far = (CandidateSet((known[f'{e.identifier}:{e.site}'],), (np.array(e.values),))
                 for e in (clamp, base))
    centre = RefinedFit.refine(near, BaseModel(REFERENCE), data)
    plain = fit_set(centre.likelihood, CauseSet(far.hypotheses, data.duration), far.starts,
                    centre.fit.error_scale).log_evidence
    found = NeighbourFitter(centre.likelihood, centre.fit.error_scale, data.duration)(far)
    refined = RefinedFit.refine(CandidateSet.of(found), BaseModel(REFERENCE), data).fit
    # The rest needs the parts' Jacobian around itself.
    assert found.log_evidence - plain > 0.4 * (refined.log_evidence - plain) > 5.0


def test_another_robot_is_fitted_along_its_own_trajectory_too() -> None:
    """Along that of a weaker link, a payload held beyond the tip is further behind it."""
    case = TruthCase(14971, (('payload_offset', {'beyond': 0.156}),), 'quanser_2dsfl', 20.0,
                     0.19, 0.19)
    log = make_record(case)
    made = Record('made', log.time, log.command, np.hstack([log.joint, log.strain]), 0.19)
    base = nominal_base(load_robot('quanser_2dsfl'), 'assumed_modes', 3)
    data = Data.of([made.thinned(2)], slowest_frequency(base, 0.19), 0.004)
    base = replace(base, robot=replace(base.robot, sample_time=0.004))
    known = {h.label: h for h in all_hypotheses(base.robot)}
    beyond = CandidateSet((known['payload_offset:arm'],), (np.array([0.05]),))
    gained = []
    for label, value in (('link_stiffness:link_2', 0.5), ('payload_mass:arm', 0.1)):
        centre = RefinedFit.refine(
            CandidateSet((known[label],), (np.array([value]),)), base, data)
        plain = fit_set(centre.likelihood, CauseSet(beyond.hypotheses, data.duration),
                        beyond.starts, centre.fit.error_scale)
        found = NeighbourFitter(centre.likelihood, centre.fit.error_scale, data.duration)(beyond)
        gained.append(found.log_evidence - plain.log_evidence)
    assert gained[0] > 20.0, 'its own trajectory shows what it explains'
    assert gained[1] == 0.0, 'or does not, as the parts are still those of the other set'


def test_evidence_is_the_same_wherever_it_is_linearised_first() -> None:
    # Parts off so far that their columns around the file are not those where they are.
    base, parts = BaseModel(REFERENCE), part_priors(REFERENCE, REFERENCE.payload_mass)
    off = {'damping_1': 1.5, 'stiffness_1': -2.0, 'stiffness_2': 2.0, 'drive_gain_1': -1.0}
    true = np.array([off.get(part.name, 0.0) * part.tolerance for part in parts])
    record = simulated((), 14.0, robot=with_deviations(REFERENCE, parts, true)[0])
    data = Data.of([record], SLOWEST, REFERENCE.sample_time)
    from_file, from_truth = (
        RefinedFit.refine(CandidateSet((), (np.zeros(0),), deviations), base, data).fit
        for deviations in (None, true))
    plain = fit_set(Likelihood(base, data.windows, data.noise), CauseSet((), data.duration),
                    (np.zeros(0),))
    assert from_file.log_evidence == pytest.approx(from_truth.log_evidence, abs=0.5)
    assert from_file.log_evidence > plain.log_evidence + 2.0


def test_another_trajectory_keeps_the_jacobian_and_has_its_own_residual() -> None:
    record = simulated(effects('coulomb_friction:joint_1:level_n_m=0.4'), 14.0)
    data, base = Data.of([record], SLOWEST, REFERENCE.sample_time), BaseModel(REFERENCE)
    first = Likelihood(base, data.windows, data.noise)
    deviations = 0.5 * np.array([part.tolerance for part in first.parts])
    friction = effects('coulomb_friction:joint_1:level_n_m=0.3')
    fresh = Likelihood(base, data.windows, data.noise, friction, deviations)
    jacobian, _ = first.part_jacobian, first.centre_shift
    moved = first.along_trajectory_of(friction, deviations)
    assert moved.part_jacobian is jacobian
    np.testing.assert_array_equal(moved.whitened_residual(friction, deviations),
                                  fresh.whitened_residual(friction, deviations))
    np.testing.assert_allclose(moved.centre_shift, np.tensordot(deviations, jacobian, 1))


def test_parts_are_differentiated_as_they_are_compared() -> None:
    """With the centre's gain, derivatives were 8 and 9 % off: fits ended 50 nats below others."""
    data = Data.of([elements(16.0)], SLOWEST, REFERENCE.sample_time)
    likelihood = Likelihood(BaseModel(REFERENCE), data.windows, data.noise)
    for k, part in enumerate(likelihood.parts):
        if part.name == 'payload_inertia':
            # Not below zero, which is that of the file.
            continue
        step = np.zeros(len(likelihood.parts))
        step[k] = 0.05 * part.tolerance
        slope = (likelihood.whitened_residual((), step)[0]
                 - likelihood.whitened_residual((), -step)[0]) / (2.0 * step[k])
        error = likelihood.part_jacobian[k] - slope
        assert np.linalg.norm(error) < 0.05 * np.linalg.norm(slope), part.name


def elements(seconds: float) -> Record:
    """Return a record of finite elements whose parts are as far off as told."""
    truth = make_record(TruthCase(7304, duration_s=seconds, spread=TOLD))
    return Record('elements', truth.time, truth.command,
                  np.column_stack([truth.joint, truth.strain]), 0.1)


def test_what_fits_elements_with_parts_as_far_off_as_told_gains_nothing_by_another_fit() -> None:
    # Of another form, so that the parts' columns, and Occam's factor, change where they are found.
    data, base = Data.of([elements(14.0)], SLOWEST, REFERENCE.sample_time), BaseModel(REFERENCE)
    first = RefinedFit.refine(CandidateSet((), (np.zeros(0),)), base, data).fit
    again = RefinedFit.refine(CandidateSet.of(first), base, data).fit
    assert again.log_evidence - first.log_evidence < 0.5


def test_a_factor_in_place_of_its_part_is_told_by_the_part_s_own_jacobian() -> None:
    base, parts = BaseModel(REFERENCE), part_priors(REFERENCE, REFERENCE.payload_mass)
    place = [part.name for part in parts].index('stiffness_2')
    stiffer = 6.0 * parts[place].tolerance * np.eye(len(parts))[place]
    record = simulated((), 14.0, robot=with_deviations(REFERENCE, parts, stiffer)[0])
    data = Data.of([record], SLOWEST, REFERENCE.sample_time)
    nothing = RefinedFit.refine(CandidateSet((), (np.zeros(0),)), base, data)
    asked = [h for h in all_hypotheses(REFERENCE) if h.label == 'link_stiffness:link_2']
    told, = fits_replacing_parts(nothing, asked)
    # Both together are one coordinate with the sum of their variances.
    wide = nothing.fit.statistics.tolerances.copy()
    wide[place] = np.hypot(wide[place], asked[0].parameters[0].typical)
    both = replace(nothing.fit.statistics, tolerances=wide)
    assert told.log_evidence == pytest.approx(both.log_evidence(nothing.fit.error_scale), abs=0.5)
    assert told.log_evidence > nothing.fit.log_evidence + 3.0
    refined = RefinedFit.refine(CandidateSet.of(told), base, data).fit
    assert told.values == pytest.approx(refined.values, rel=0.005)


def test_a_gauge_far_off_its_tolerance_is_a_cause() -> None:
    # Its part is held back by its tolerance, so that other parts share what it does.
    wrong, = effects('strain_gain:strain_2a:factor=1.2')
    data = Data.of([simulated((wrong,), 14.0)], SLOWEST, REFERENCE.sample_time)
    base = BaseModel(REFERENCE)
    nothing = RefinedFit.refine(CandidateSet((), (np.zeros(0),)), base, data)
    told, = (fit for fit in fits_replacing_parts(nothing, all_hypotheses(REFERENCE))
             if fit.hypotheses[0].label == 'strain_gain:strain_2a')
    assert told.log_evidence > nothing.fit.log_evidence + 10.0
    refined = RefinedFit.refine(CandidateSet.of(told), base, data).fit
    assert refined.values[0] == pytest.approx(1.2, rel=0.02)
    assert refined.log_evidence > told.log_evidence + 10.0


def test_a_resonant_effect_is_fitted_from_each_probed_size() -> None:
    # A size sets a frequency: between two probed sizes the residual is not linear.
    data = Data.of([simulated(effects(
        'loose_payload:arm:compliance_m_per_n=0.045,damping_ratio=0.05'), 14.0)],
        SLOWEST, REFERENCE.sample_time)
    asked, base = ('loose_payload', 'clamp_compliance'), BaseModel(REFERENCE)
    state = SearchState(data, base, 1, [name for name in catalogue() if name not in asked],
                        lambda *told: None)
    nothing = state.refine(CandidateSet((), (np.zeros(0),)), base.discrepancy)
    probe_catalogue(state, nothing)
    starts: dict[str, list[float]] = {}
    proposals = proposals_beside(state, nothing)
    for candidate in candidates(state, nothing, proposals, []):
        for h in candidate.hypotheses:
            starts.setdefault(h.label, []).append(candidate.starts[0][0])
    resonant, = (h for h, _ in state.sensitivities if h.label == 'loose_payload:arm')
    probed = [size for size in resonant.parameters[0].starts if size > 0.0]
    # And from the linear optimum: a size may be smaller than all that were probed.
    assert set(np.round(probed, 9)) < set(np.round(starts[resonant.label], 9))
    assert len(starts['clamp_compliance:link_1']) == 1
    # Nor does the linear gain tell how much it gains: without one, the best start is tried.
    hopeless = [replace(p, linear_gain=-9.0) for p in proposals]
    single, = unpromised(state, nothing, hopeless, [], 'again')
    assert [h.label for h in single.hypotheses] == [resonant.label]
    assert single.starts[0][0] == pytest.approx(0.045, rel=0.3)
    deserving = {p.hypothesis.label: state.deserves_fit(50, replace(p, linear_gain=100.0))
                 for p in proposals}
    assert deserving[resonant.label] and not deserving['clamp_compliance:link_1']


def test_what_was_not_fitted_does_not_pay_for_what_linear_gains_promised_of_others() -> None:
    data = Data.of([simulated((), 14.0)], SLOWEST, REFERENCE.sample_time)
    asked, base = ('link_stiffness', 'viscous_friction', 'strain_gain'), BaseModel(REFERENCE)
    state = SearchState(data, base, 1, [name for name in catalogue() if name not in asked],
                        lambda *told: None)
    nothing = state.refine(CandidateSet((), (np.zeros(0),)), base.discrepancy)
    probe_catalogue(state, nothing)
    around = fit_neighbours(state, nothing)
    promised = [replace(p, linear_gain=60.0) for p in around.proposals]
    scores = replace(around, proposals=tuple(promised)).unfitted_scores(state)
    null = {p.hypothesis.label: state.score_at_null(p) for p in promised}
    assert len(scores) > 5
    # By algebra an effect of which the record shows nothing has its linear evidence at null.
    for proposal in around.proposals:
        assert proposal.linear_gain + proposal.occam == pytest.approx(0.0, abs=3.0)
    for labels, score in scores.items():
        label, = labels
        assert score - state.score(nothing.fit) == pytest.approx(null[label], abs=2.0), label


def test_a_gear_is_started_with_a_heavy_output_too() -> None:
    data = Data.of([simulated((), 14.0)], SLOWEST, REFERENCE.sample_time)
    base, others = BaseModel(REFERENCE), [n for n in catalogue() if n != 'gear_compliance']
    state = SearchState(data, base, 1, others, lambda *told: None)
    nothing = state.refine(CandidateSet((), (np.zeros(0),)), base.discrepancy)
    probe_catalogue(state, nothing)
    # Only with inertia behind it the twist has a coordinate, which no slope from zero shows.
    assert state.resonant == {'gear_compliance:joint_1', 'gear_compliance:joint_2'}
    share = [p.name for p in catalogue()['gear_compliance'].parameters].index('hub_share')
    assert any(values[share] > 0.0 for proposal in proposals_beside(state, nothing)
               for values in proposal.probe_starts)


def test_what_is_forgotten_where_laws_lead_can_be_computed_again() -> None:
    data, base = Data.of([simulated((), 14.0)], SLOWEST, REFERENCE.sample_time), BaseModel(
        REFERENCE)
    state = SearchState(data, base, 1, (), lambda *told: None)
    nothing = state.refine(CandidateSet((), (np.zeros(0),)), base.discrepancy)
    # A search that goes on from a far part alone, as `event_pays` does, has a best set, too.
    far = replace(nothing, fit=replace(
        nothing.fit, log_evidence=nothing.fit.log_evidence + 9.0,
        discrepancy=replace(base.discrepancy, far_part='elbow_mass')))
    known, state.refined = state.refined, {SetKey.of(far.fit): far}
    assert state.best is far
    state.refined = {**state.refined, **known}
    assert state.best is nothing
    state.refined = known
    state.keep_light_without_laws()
    light, = state.refined.values()
    assert 'part_jacobian' in vars(nothing.likelihood)
    assert not {'part_jacobian', 'centre_residual'} & set(vars(light.likelihood))
    assert light.fit is nothing.fit and light.likelihood.parts == nothing.likelihood.parts
    difference = light.likelihood.part_jacobian - nothing.likelihood.part_jacobian
    assert np.linalg.norm(difference) < 0.01 * np.linalg.norm(nothing.likelihood.part_jacobian)


def test_single_causes_are_fitted_around_the_parts_of_the_file() -> None:
    # Within three tolerances the parts stand for the softer link as well.
    off = effects('link_stiffness:link_1:factor=0.95')
    data, base = Data.of([simulated(off, 14.0)], SLOWEST, REFERENCE.sample_time), BaseModel(
        REFERENCE)
    nothing = RefinedFit.refine(CandidateSet((), (np.zeros(0),)), base, data)
    assert np.any(nothing.likelihood.centre_deviations != 0.0)
    near = nothing.near_file_parts(base, data)
    np.testing.assert_array_equal(near.likelihood.centre_deviations, 0.0)


@pytest.mark.parametrize('hidden, label, start', [
    # The Jacobian at the file's parts predicts too much.
    ('link_stiffness:link_1:factor=1.3', None, None),
    # From far off it predicts what is found there, and not how much is left.
    ('payload_offset:arm:offset_m=-0.05', 'payload_offset:arm', -0.02)])
def test_a_set_that_cannot_matter_is_not_linearised_again(
        hidden: str, label: str | None, start: float | None) -> None:
    data = Data.of([simulated(effects(hidden), 22.0)], SLOWEST, REFERENCE.sample_time)
    asked: list[float] = []

    def worth_refining(fit: Fit, more: float) -> bool:
        asked.append(more)
        return False

    begun = CandidateSet(tuple(h for h in all_hypotheses(REFERENCE) if h.label == label),
                         (np.array([] if start is None else [start]),))
    once, again = (
        RefinedFit.refine(begun, BaseModel(REFERENCE), data, worth_refining=how).fit.log_evidence
        for how in (worth_refining, lambda fit, more: True))
    assert len(asked) == 1
    assert once + 1.0 < again < once + asked[0], 'it gains less than it was told may be'


def test_a_slope_is_taken_within_a_standard_deviation() -> None:
    # A loop whose damping lags a little more than whole is unstable: a twentieth is too far.
    values = np.array([0.1, 1.0])
    lag = effects('motor_lag:joint_2:time_constant_s=0.1,inside_loop=1')
    data = Data.of([simulated(lag, 14.0)], SLOWEST, REFERENCE.sample_time)
    causes = CauseSet([h for h in all_hypotheses(REFERENCE) if h.label == 'motor_lag:joint_2'],
                      data.duration)
    solver = GaussNewton(Likelihood(BaseModel(REFERENCE), data.windows, data.noise, lag), causes,
                         np.ones(len(REFERENCE.output_names)))
    point = solver.descend([values])
    precision = np.linalg.inv(solver.fit(point).covariance[:2, :2])
    for step in np.diag(np.diagonal(precision)**-0.5):
        rise = [solver.residual_and_cost(point.values + sign * step)[1] - point.cost
                for sign in (-1.0, 1.0)]
        # Half a nat, by what a standard deviation is.
        assert np.mean(rise) == pytest.approx(0.5, abs=0.25)


@pytest.mark.parametrize('start', [(-0.06, 2.0, 10.0), (-0.03, 4.0, 20.0)])
def test_an_event_is_found_wherever_its_fit_ends(start: tuple[float, ...]) -> None:
    dropped = effects('payload_change:arm:change_kg=-0.06,time_s=12,duration_s=0')
    data = Data.of([simulated(dropped, 28.0)], SLOWEST, REFERENCE.sample_time)
    event, = (h for h in all_hypotheses(REFERENCE) if h.label == 'payload_change:arm')
    base = BaseModel(REFERENCE)
    solver = GaussNewton(Likelihood(base, data.windows, data.noise),
                         CauseSet((event,), data.duration), np.ones(len(REFERENCE.output_names)))
    # A change of seconds is a local minimum; integrated over all times, it does not matter.
    assert solver.descend((np.array(start),)).values[2] > 5.0
    found = RefinedFit.refine(CandidateSet((event,), (np.array(start),)), base, data).fit
    assert found.values == pytest.approx([-0.06, 12.0, 0.0], abs=0.05)


def test_causes_without_the_trajectory_s_shapes_are_predicted_one_at_a_time() -> None:
    truncated = effects('modal_truncation:arm:modes=4')
    data = Data.of([simulated((), 14.0)], SLOWEST, REFERENCE.sample_time)
    likelihood = Likelihood(BaseModel(REFERENCE, 'paper', 2), data.windows, data.noise, truncated)
    bias, = (h for h in all_hypotheses(REFERENCE) if h.label == 'strain_bias:strain_1a')
    causes, values = CauseSet((bias,), data.duration), np.array([[1e-5], [2e-4]])
    each = np.concatenate([causes.residual(likelihood, value[None]) for value in values])
    np.testing.assert_array_equal(causes.residual(likelihood, values), each)
    assert np.abs(each[0] - each[1]).max() > 1.0


def test_nothing_is_asked_around_its_own_parts_before_it_is_the_answer() -> None:
    # Where parts are as far off as told, causes make up for parts around the file's.
    base, parts = BaseModel(REFERENCE), part_priors(REFERENCE, REFERENCE.payload_mass)
    off = np.array([(1.5 if k % 2 else -1.5) * part.tolerance for k, part in enumerate(parts)])
    robot, sensors = with_deviations(REFERENCE, parts, off)
    data = Data.of([simulated(sensors, 22.0, robot=robot)], SLOWEST, REFERENCE.sample_time)
    asked = ('coulomb_friction', 'strain_bias')
    state = SearchState(data, base, 1, [name for name in catalogue() if name not in asked],
                        lambda *told: None)
    nothing = state.refine(CandidateSet((), (np.zeros(0),)), base.discrepancy)
    near_file = nothing.near_file_parts(base, data)
    probe_catalogue(state, near_file)
    around, = _explored(state, nothing, near_file).values()
    assert around.centre is state.refined[SetKey.of(nothing.fit)].fit
    assert around.centre.log_evidence > near_file.fit.log_evidence + 5.0
