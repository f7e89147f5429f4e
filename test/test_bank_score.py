"""How the bank scores: shares, sets, calibration, coverage, terms."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
import math
from typing import Any

from bank import score, summary
from bank.cases import (
    all_cases,
    BankCase,
    first,
    FIRST_SEED,
    FORMS_OF,
    Realisation,
    realisations,
    SIZES,
    TAKEN_OUT,
)
from bank.records import control
from bank.sizes import can_show, DRY, Limits, over_threshold, sized_truth
from bank.terms import hidden_terms, Term
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.effects import catalogue
import numpy as np
import pytest
from truth.effects import CATALOGUE
from truth.records import build_arm, draw_case, HAVE_MUJOCO, make_record, MUJOCO, TruthCase
from truth.tolerances import AS_TOLD, TOLD


def line(hidden: list[str], causes: dict[str, float], verdict: str = 'cause',
         look_alikes: tuple[str, ...] = (), cannot_tell: tuple[tuple[str, ...], ...] = (),
         kind: str = 'one', form: str = '') -> dict[str, Any]:
    """Return a line of results."""
    return {'kind': kind, 'names': hidden, 'verdict': verdict, 'code': 0, 'complaint': '',
            'key': 'x', 'robot': 'reference', 'seed': 5001, 'seconds': 1.0, 'size': 4.0,
            'spread': 'good', 'simulator': 'mujoco', 'form': form, 'calibration': False,
            'truth': [{'name': name, 'site': 'joint_2', 'values': {'level_n_m': 0.4},
                       'times_limit': None} for name in hidden],
            'causes': [{'name': name, 'site': 'joint_2', 'probability': probability,
                        'look_alikes': list(look_alikes),
                        'parameters': {'level_n_m': {'value': 0.41, 'low': 0.39, 'high': 0.43}}}
                       for name, probability in causes.items()],
            'cannot_tell': [list(group) for group in cannot_tell]}


@pytest.mark.parametrize('right, total, low, high', [
    (0, 10, 0.0, 0.2775), (10, 10, 0.7225, 1.0), (81, 263, 0.2553, 0.3662)])
def test_wilson_intervals_of_the_literature(right: int, total: int, low: float,
                                            high: float) -> None:
    """81 of 263: Newcombe, Statistics in Medicine 17 (1998), table I; the others by (1)."""
    assert score.Share(right, total).interval == pytest.approx((low, high), abs=1e-4)


def test_exact_means_that_name_and_no_other() -> None:
    assert score.exact(line(['coulomb_friction'], {'coulomb_friction': 0.9}))
    assert not score.exact(line(['coulomb_friction'], {'coulomb_friction': 0.9, 'backlash': 0.5}))
    assert not score.exact(line(['coulomb_friction'], {}))
    assert score.exact(line([], {}, 'nothing_wrong'))


def test_a_set_counts_up_to_three() -> None:
    hidden = ['strain_delay']
    assert score.in_small_set(line(hidden, {'strain_filter': 0.5},
                                   look_alikes=('strain_delay:arm',)))
    assert score.in_small_set(line(hidden, {'strain_filter': 0.5}, 'cannot_tell',
                                   cannot_tell=(('strain_filter', 'strain_delay'),)))
    assert not score.in_small_set(line(hidden, {'strain_filter': 0.5}, look_alikes=(
        'strain_delay', 'input_delay', 'motor_lag')))
    assert not score.in_small_set(line(hidden, {'strain_filter': 0.9}))


def test_doubt_and_sure_errors() -> None:
    hidden = ['coulomb_friction']
    unknown = line(hidden, {}, 'not_in_catalogue')
    doubted = line(hidden, {'stribeck_friction': 0.6}, 'cannot_tell')
    sure_wrong = line(hidden, {'strain_gain': 0.97})
    sure_right = line(hidden, {'coulomb_friction': 0.97})
    missed = line(hidden, {}, 'nothing_wrong')
    cases = [unknown, doubted, sure_wrong, sure_right, missed]
    assert [score.doubt_stated(c) for c in cases] == [True, True, False, False, False]
    assert [score.surely_wrong(c) for c in cases] == [False, False, True, False, False]
    assert not score.surely_wrong({**sure_wrong, 'distractors': ['strain_gain']})
    # At most 0.88 is stated; doubt of something else does not excuse it.
    beside = line(hidden, {'strain_gain': 0.88}, 'cause_and_remainder')
    assert score.surely_wrong(beside) and score.doubt_stated(beside)
    assert not score.doubt_stated(line(hidden, {'strain_gain': 0.88}))


def test_log_score_against_its_definition() -> None:
    """A name that is not mentioned counts as a thousandth; the two look-alikes share the rest."""
    told = line(['coulomb_friction'], {'stribeck_friction': 0.8},
                look_alikes=('coulomb_friction:joint_1', 'backlash:joint_2'))
    silent = len(CATALOGUE) - 3
    assert score.log_score(told) == pytest.approx(
        math.log(0.2) + math.log(0.1) + math.log(0.9) + silent * math.log(0.999))
    missing = line(['coulomb_friction'], {'stribeck_friction': 0.8}, kind='missing')
    assert score.log_score(missing) == pytest.approx(
        math.log(0.2) + (len(CATALOGUE) - 1) * math.log(0.999))


def test_names_get_the_sum_over_the_sets_that_hold_them() -> None:
    told = line(['backlash'], {'backlash': 0.9})
    told['sets'] = [{'causes': ['backlash:joint_1'], 'probability': 0.5},
                    {'causes': ['backlash:joint_2', 'unknown'], 'probability': 0.2},
                    {'causes': [], 'probability': 0.3}]
    assert score.stated(told) == pytest.approx({'backlash': 0.7, 'unknown': 0.2})


def test_log_score_is_proper() -> None:
    """Over many cases, stating what is so pays better than boasting and than hedging."""
    rng = np.random.default_rng(3)
    right = rng.random(600) < 0.7
    means = [np.mean([score.log_score(line(['backlash' if so else 'motor_lag'],
                                           {'backlash': stated}, look_alikes=('motor_lag:x',)))
                      for so in right]) for stated in (0.7, 0.5, 0.99)]
    assert means[0] > max(means[1:])


def test_calibration_of_an_honest_and_of_a_boastful_forecaster() -> None:
    rng = np.random.default_rng(0)
    stated = rng.uniform(0.2, 1.0, 4000)
    honest = [(p, bool(rng.random() < p)) for p in stated]
    boastful = [(0.99, bool(rng.random() < 0.6)) for _ in range(4000)]
    assert score.calibration(honest)[0] < 0.03
    assert score.calibration(boastful)[0] == pytest.approx(0.39, abs=0.03)
    assert math.isnan(score.calibration([])[0])
    assert sum(count for _, _, count in score.calibration(honest)[1]) == 4000


def test_coverage_counts_parameters_of_right_names_at_right_sites() -> None:
    right = line(['coulomb_friction'], {'coulomb_friction': 0.9})
    elsewhere = line(['coulomb_friction'], {'coulomb_friction': 0.9})
    elsewhere['causes'][0]['site'] = 'joint_1'
    off = line(['coulomb_friction'], {'coulomb_friction': 0.9})
    off['truth'][0]['values']['level_n_m'] = 0.5
    held, rows = score.coverage([right, elsewhere, off])
    assert (held.right, held.total) == (1, 2)
    assert [row[2] for row in rows] == [True, False]
    assert score.right_site(right) and not score.right_site(elsewhere)


def test_two_runs_are_compared_case_by_case() -> None:
    old = [{**line(['backlash'], {'motor_lag': 0.99}), 'key': str(k)} for k in range(3)]
    new = [{**line(['backlash'], {'backlash': 0.99}), 'key': str(k)} for k in range(1, 5)]
    gain = math.log(0.99) + math.log(0.999) - math.log(0.01) - math.log(0.001)
    text = summary.paired(new, old)
    assert text.startswith('2 cases in common') and f'gain {gain:+.2f} +- 0.00' in text
    assert 'exact 2 against 0, surely wrong 0 against 2' in text


def test_confusion_counts_every_case_once() -> None:
    lines = [line(['coulomb_friction'], {'coulomb_friction': 0.9}),
             line(['coulomb_friction'], {'stribeck_friction': 0.9}),
             line(['backlash'], {'backlash': 0.5, 'motor_lag': 0.5}),
             line([], {}, 'nothing_wrong', kind='clean')]
    hidden, columns, counts = score.confusion(lines)
    assert counts.sum() == 4
    assert counts[hidden.index('coulomb_friction'), columns.index('stribeck_friction')] == 1
    assert counts[hidden.index('backlash'), columns.index('several')] == 1
    assert counts[hidden.index('nothing'), columns.index('nothing_wrong')] == 1
    text = summary.text(lines, 'abc1234')
    assert '| exact name at 4 limits and more | >= 90 % | 33.3 %' in text
    assert 'commit abc1234' in text and '**missed**' in text and 'scoring, from 5000' in text
    assert 'coulomb_friction' in summary.terminal_matrix(lines)


def test_bank_holds_what_it_promises() -> None:
    cases = list(all_cases())
    counts = Counter(case.kind for case in cases)
    assert counts['clean'] >= 100 and counts['missing'] >= 40 and counts['pair'] >= 30
    assert len({case.key for case in cases}) == len({case.seed for case in cases}) == len(cases)
    assert set(CATALOGUE) == set(catalogue())
    for name in CATALOGUE:
        own = [case for case in cases if case.kind == 'one' and case.names == (name,)]
        assert len(own) >= 9
        assert {case.realisation.simulator for case in own} == {
            form.simulator for form in realisations(name)}
        assert {case.size for case in own} == set(SIZES)
    assert {case.names[0] for case in cases if case.kind == 'missing'} >= set(TAKEN_OUT[:30])
    assert len(first(all_cases(), 'clean/', 7)) == 7


def test_calibration_never_meets_what_scores() -> None:
    tuned, scored = list(all_cases('calibration')), list(all_cases('scoring'))
    assert max(case.seed for case in tuned) < FIRST_SEED['scoring']
    assert min(case.seed for case in scored) >= FIRST_SEED['scoring']
    assert all(case.realisation.calibration for case in tuned)
    assert not all(case.realisation.calibration for case in scored)


@pytest.mark.parametrize('robot', ['reference', 'quanser_2dsfl'])
def test_every_hidden_effect_has_its_catalogue_terms(robot: str) -> None:
    for name in CATALOGUE:
        case = draw_case(name, 3, robot)
        term, = hidden_terms(case)
        parameters = [p.name for p in catalogue()[name].parameters]
        assert term.name == name
        assert set(term.values) <= set(parameters)
        for key, value in term.values.items():
            parameter = catalogue()[name].parameters[parameters.index(key)]
            assert parameter.low <= value <= parameter.high, (name, key, value)


@pytest.mark.parametrize('name, form', [
    (name, form) for name, forms in FORMS_OF.items() for form in forms
    if form.form and (HAVE_MUJOCO or form.simulator != MUJOCO)])
def test_every_form_shows_in_the_record(name: str, form: Realisation) -> None:
    """Under one command a form is neither the plain effect nor none."""
    case = BankCase('missing', (name,), 'reference', 3, form).truth(2.0)
    event = {'time': 0.2, 'duration': 0.0} if name == 'payload_change' else {}
    (_, size), = case.effects
    case = replace(case, duration_s=0.6, noise=0.0, effects=((name, {**size, **event}),))
    command = 0.4 * np.sin(np.outer(0.01 * np.arange(60), [9.0, 14.0]))
    formed, plain, clean = (make_record(c, command).table for c in (
        case, replace(case, forms=()), replace(case, effects=(), forms=())))
    assert np.abs(formed - plain).max() > 1e-7
    assert np.abs(formed - clean).max() > 1e-7


def test_the_paper_s_model_hides_all_that_it_leaves_out() -> None:
    both = BankCase('one', ('modal_truncation',), 'reference', 1000).hidden
    assert both == ('modal_truncation', 'coriolis_centripetal')
    assert score.exact(line(list(both), dict.fromkeys(both, 0.9)))
    assert not score.exact(line(list(both), {'coriolis_centripetal': 0.9}))
    slow = BankCase('one', ('modal_truncation',), 'quanser_2dsfl', 1000).hidden
    assert slow == ('modal_truncation',)


def alike(limits: dict[str, float]) -> Limits:
    """Return limits of effects that are as hard to see in every form."""
    return Limits(limits, limits)


@pytest.mark.parametrize('size', SIZES)
def test_sizes_are_so_many_detection_limits(size: float) -> None:
    case = BankCase('missing', ('coulomb_friction',), 'reference', 1000, size=size)
    _, (drawn,) = sized_truth(case, alike({}))
    limits = {f'coulomb_friction:{drawn.site}': 0.3 * drawn.size}
    _, (sized,) = sized_truth(case, alike(limits))
    assert sized.size == pytest.approx(size * 0.3 * drawn.size, rel=1e-4)


def test_what_no_clean_record_shows_is_not_asked_for() -> None:
    hidden = BankCase('one', ('strain_crosstalk',), 'reference', 1000)
    assert not can_show(hidden, alike({'coulomb_friction:joint_1': 0.3}))
    assert can_show(hidden, alike({'strain_crosstalk:strain_1a': 0.3}))
    # What a told model leaves out has no size; a clean arm hides nothing.
    assert can_show(BankCase('one', ('modal_truncation',), 'reference', 1000), alike({}))
    assert can_show(BankCase('clean', (), 'reference', 1000, size=0.0), alike({}))


def test_a_size_beyond_reach_stays_at_the_largest() -> None:
    case = BankCase('missing', ('link_stiffness',), 'reference', 1000)
    _, (drawn,) = sized_truth(case, alike({}))
    _, (sized,) = sized_truth(case, alike({f'link_stiffness:{drawn.site}': 100.0 * drawn.size}))
    assert sized.size == pytest.approx(4.0 * drawn.size, rel=1e-4)


def test_a_third_is_one_more_than_two_and_not_there() -> None:
    hidden = ['viscous_friction', 'strain_gain']
    both = {'viscous_friction': 0.9, 'strain_gain': 0.9}
    third = line(hidden, {**both, 'air_drag': 0.06}, kind='pair')
    assert score.one_too_many(third) and score.named_wrongly(third)
    there = {**third, 'distractors': ['air_drag']}
    assert not score.one_too_many(there) and score.named_wrongly(there)
    exchanged = line(hidden, {'viscous_friction': 0.9, 'strain_crosstalk': 0.6}, kind='pair')
    assert not score.one_too_many(exchanged) and score.named_wrongly(exchanged)
    assert not score.named_wrongly(line(hidden, both, kind='pair'))


def test_distractors_stay_below_half_a_detection_limit() -> None:
    limits = alike({f'{name}:{site}': 1e-3 for name in CATALOGUE
                    for site in ('arm', 'elbow', 'joint_1', 'joint_2', 'link_1', 'link_2',
                                 'strain_1a', 'strain_1b', 'strain_2a', 'strain_2b')})
    for seed in range(1000, 1030):
        truth, terms = sized_truth(BankCase('clean', (), 'reference', seed), limits)
        assert terms == ()
        assert len(DRY & set(truth.names)) <= 1
        assert len(truth.effects) == 2 or DRY & set(truth.names)
        for term in hidden_terms(truth):
            assert over_threshold(term, limits) < 0.5001, term


def test_a_distractor_is_measured_by_the_form_and_the_name_that_show_first() -> None:
    # Of a gear's 0.0005 rad/(N m), 0.29 of a limit that was that of a sensor on the motor, all of
    # three records told.
    limits = Limits({'gear_compliance:joint_1': 1.7e-3},
                    {'gear_compliance:joint_1': 3e-4, 'coulomb_friction:joint_1': 0.03,
                     'asymmetric_friction:joint_1': 0.06})
    gear = Term('gear_compliance', 'joint_1', size=5e-4)
    assert over_threshold(gear, limits) == pytest.approx(5.0 / 3.0)
    friction = Term('asymmetric_friction', 'joint_1', size=0.03)
    assert over_threshold(friction, limits) == pytest.approx(1.0)


def test_presliding_is_no_distractor_beside_dry_friction() -> None:
    """A true joint has one travel: seed 1003 draws it, and springs would be what is hidden."""
    truth, _ = sized_truth(BankCase('one', ('coulomb_friction',), 'reference', 1003), alike({}))
    assert truth.names == ('coulomb_friction', 'strain_delay')
    beside, _ = sized_truth(BankCase('one', ('viscous_friction',), 'reference', 1003), alike({}))
    assert 'presliding_friction' in beside.names


def test_shuffled_residuals_keep_their_size_and_lose_their_order() -> None:
    case = BankCase('control', ('shuffled_residuals',), 'reference', 700)
    clean = control(BankCase('control', ('swapped_joint_labels',), 'reference', 700))
    added = control(case).strain - clean.strain
    assert np.std(added) > 1e-6
    step = added[:, 0] - added[:, 0].mean()
    assert abs(step[1:] @ step[:-1] / (step @ step)) < 0.1


def test_right_probabilities_err_by_chance_as_much_as_few_cases_must() -> None:
    """With p = 1/2 in 5 bins of n: |share - 1/2| is on average 1 / sqrt(2 pi n)."""
    pairs = [(0.5, True)] * (5 * 40)
    mean, most = score.calibration_by_chance(pairs)
    assert mean == pytest.approx(1.0 / math.sqrt(2.0 * math.pi * 40), rel=0.05)
    assert mean < most < 2.0 * mean


@pytest.mark.parametrize('name', sorted(AS_TOLD))
def test_told_arms_are_as_far_off_as_the_robot_file_says(name: str) -> None:
    told, spread = load_robot(name).tolerances, AS_TOLD[name]
    assert [spread.stiffness, spread.link_mass, spread.damping, spread.elbow_mass,
            spread.elbow_inertia, spread.drive_inertia, spread.drive_gain, spread.drive_damping,
            spread.gauge_gain, spread.gauge_position, spread.payload, spread.length,
            spread.gauge_bias, spread.angle_zero, spread.payload_inertia] == [
                told.stiffness, told.link_mass, told.damping, told.elbow_mass,
                told.elbow_inertia, told.drive_inertia, told.drive_gain, told.drive_damping,
                told.strain_gain, told.gauge_position_m, told.payload, told.length,
                told.strain_bias, told.angle_zero_rad, told.payload_inertia_kg_m2]
    assert spread.closed_loop == load_robot(name).drives[0].closed_loop
    drawn = [build_arm(TruthCase(seed, robot=name, spread=TOLD)) for seed in range(300)]
    speed = np.log([arm.joints[0].torque_gain / arm.joints[0].damping for arm in drawn])
    wide = told.drive_gain if spread.closed_loop else np.hypot(told.drive_gain, told.drive_damping)
    assert np.std(speed) == pytest.approx(wide, rel=0.15)
    assert np.std(np.log([arm.links[1].youngs_modulus for arm in drawn])) == pytest.approx(
        told.stiffness, rel=0.15)
