"""What decides between hypotheses of the recursive-prediction-error estimator, one rule each."""

from __future__ import annotations

from dataclasses import replace

from flex_payload_estimator.estimators.rpe import transitions
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_payload_estimator.estimators.rpe.filter import Filter
from flex_payload_estimator.estimators.rpe.likelihood import false_alarm_threshold
from flex_payload_estimator.estimators.rpe.modes import EXACT, Mode, MODES, PARTS_FREE, ROUGH
from flex_payload_estimator.estimators.rpe.restarts import relinearised, with_payload_walk
from flex_payload_estimator.estimators.rpe.trial import Trial
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.simulation.payload_profile import PayloadProfile
import numpy as np
import pytest
from rpe_runs import estimator_of, Run
from truth.records import draw_case, make_record

COARSE = MODES[2]


def of_mode(mode: Mode, age: float = 9.0) -> Filter:
    """Return a filter that has learnt in motion for so long, s."""
    f = estimator_of().stepper.begin(mode, np.zeros(6), 0.1, 0.1)
    f.age = age
    return f


@pytest.mark.parametrize(('kind', 'mode', 'learnt', 'age', 'settles'), [
    # A mode that begins afresh: from then on, however long the modes have differed.
    ('mode', EXACT, 0.05, 9.0, True), ('mode', EXACT, 0.15, 0.0, False),
    ('mode', PARTS_FREE, 0.05, 9.0, True), ('mode', ROUGH, 0.05, 9.0, True),
    # A payload that stands still: from when the trial began.
    ('constant', EXACT, 9.0, 0.05, True), ('constant', EXACT, 0.05, 0.15, False),
    ('constant', ROUGH, 9.0, 0.05, True), ('change', EXACT, 0.05, 0.05, False)])
def test_who_begins_afresh_settles_for_a_tenth_of_a_second(
        kind: str, mode: Mode, learnt: float, age: float, settles: bool) -> None:
    assert Trial(kind, of_mode(mode, learnt), 0.0, 0.1, counted=age).is_settling is settles


def test_what_a_trial_loses_while_it_settles_does_not_count() -> None:
    estimator = estimator_of()
    Run(estimator, PayloadProfile.constant(0.15), 0.4)
    competition, exact = estimator._competition, estimator.incumbent.copy()
    rough, last = of_mode(ROUGH), competition.window[competition.window.end - 1]
    # So likely as no exact one is.
    rough.log_density = 1e6
    for learnt, counts in ((0.0, False), (0.5, True)):
        exact.age = learnt
        trial = Trial('mode', exact.copy(), 0.0, 0.1)
        competition._step(trial, rough, last.sample, last.loads, True)
        assert (trial.log_ratio < 0.0) is counts


@pytest.mark.parametrize(('mode', 'noise', 'age', 'wins'), [
    (COARSE, 1.0, 0.1, False), (COARSE, 1.0, 0.3, True), (COARSE, 3.9, 0.3, True),
    # A burst of noise, which looks like a wronger model until it is over.
    (COARSE, 4.1, 0.3, False), (COARSE, 4.1, 0.9, False), (COARSE, 4.1, 1.0, True),
    (ROUGH, 3.9, 0.3, True), (ROUGH, 4.1, 0.9, False), (ROUGH, 4.1, 1.0, True)])
def test_where_the_noise_has_grown_no_model_is_soon_wrong(
        mode: Mode, noise: float, age: float, wins: bool) -> None:
    estimator = estimator_of()
    Run(estimator, PayloadProfile.constant(0.15), 1.2)
    competition, incumbent = estimator._competition, of_mode(ROUGH if mode == COARSE else EXACT)
    for moment in competition.window._samples:
        moment.noise_scale = np.ones(6)
    incumbent.statistics[:6] = noise
    trial = Trial('mode', of_mode(mode), 0.0, 0.1, log_ratio=1e3, counted=age)
    assert transitions.wins(trial, competition._situation(incumbent)) is wins
    # What is given back after it was a burst's, which by the time in motion may be just over.
    trial.largest = 1e3 + 1.1 * false_alarm_threshold(estimator.stepper.step_time)
    assert transitions.wins(trial, competition._situation(incumbent)) is (wins and noise < 4.0)
    trial.restart_sum(0.0)
    assert trial.largest == trial.log_ratio == 0.0


def test_what_predicts_better_counts_before_its_trial_is_over() -> None:
    """Beside `coarse`, `rough` begun afresh; it counted after two seconds alone."""
    estimator = estimator_of()
    Run(estimator, PayloadProfile.constant(0.15), 1.2)
    competition, coarse = estimator._competition, of_mode(COARSE)
    coarse.beta_cov[0, 0], alone = 1e-4, competition.variance_factor(coarse)
    for log_ratio, mass, std, factor in (
            (50.0, 0.2, 0.01, alone * 0.01 / (1e-4 * alone + 1e-4)),
            # What leads by chance, agrees, or does not know yet says nothing.
            (5.0, 0.2, 0.01, alone), (50.0, 0.105, 0.01, alone), (50.0, 0.2, 0.2, alone)):
        rough = of_mode(ROUGH)
        rough.beta[0], rough.beta_cov[0, 0] = mass, std**2
        competition.trials = [Trial('mode', rough, 0.0, 0.1, log_ratio=log_ratio)]
        assert competition.variance_factor(coarse) == pytest.approx(factor)
    # One that has lost its lead predicts worse by now.
    rough.beta_cov[0, 0] = 1e-4
    competition.trials = [Trial('mode', rough, 0.0, 0.1, log_ratio=50.0, largest=500.0)]
    assert competition.variance_factor(coarse) == alone
    competition.trials = [Trial('mode', rough, 0.0, 0.1, log_ratio=50.0)]
    assert competition.variance_factor(coarse) > alone
    # One with as much freedom is no second opinion.
    rough.beta_cov[0, 0], rough.mode = 1e-4, COARSE
    assert competition.variance_factor(coarse) == alone


def test_a_burst_counts_as_long_as_it_is_ago_however_little_the_arm_moved() -> None:
    # Where modes hardly differ a trial ages slower than time passes.
    estimator = estimator_of()
    Run(estimator, PayloadProfile.constant(0.15), 1.2)
    competition, incumbent = estimator._competition, of_mode(ROUGH)
    for moment in competition.window._samples:
        moment.noise_scale = np.full(6, 100.0 if moment.sample.time > 0.5 else 1.0)
    incumbent.statistics[:6] = 100.0
    for since, wins in ((0.4, False), (0.8, True)):
        trial = Trial('mode', of_mode(COARSE), since, 0.1, log_ratio=1e3, counted=0.3)
        assert transitions.wins(trial, competition._situation(incumbent)) is wins


def test_a_payload_that_could_walk_and_does_not_is_as_likely_as_a_constant_one() -> None:
    # Linearised about an estimate that moves it would learn otherwise, and expect less.
    estimator = estimator_of()
    Run(estimator, PayloadProfile.constant(0.15), 1.2)
    stepper, window = estimator.stepper, estimator._competition.window
    incumbent = estimator.incumbent.copy()
    incumbent.mode = EXACT
    incumbent = relinearised(incumbent, stepper)
    walk, judged = with_payload_walk(incumbent, 0.0)
    assert judged is not None and walk.model is None
    last = window[window.end - 1]
    trial = Trial('change', walk, 0.0, 0.15, judged=judged)
    for f in (incumbent, *trial.filters):
        stepper.step(f, last.sample, last.loads)
    assert trial.sample_log_ratio(incumbent) == 0.0


def test_a_payload_that_jumps_is_judged_where_it_is_until_it_lags(
        monkeypatch: pytest.MonkeyPatch) -> None:
    estimator = estimator_of()
    Run(estimator, PayloadProfile.constant(0.15), 1.2)
    stepper, competition = estimator.stepper, estimator._competition
    last = competition.window[competition.window.end - 1]
    incumbent = relinearised(estimator.incumbent, stepper)
    walk, judged = with_payload_walk(incumbent, competition.walk)
    trial = Trial('change', walk, 0.0, 0.15, judged=judged)
    monkeypatch.setattr(stepper, 'after_jump', lambda f, *_: f.copy())
    # So unlikely, and then so likely, as no walk is.
    for likely, jumped in ((-1e6, True), (1e7, False)):
        incumbent.stated_log_density = likely
        competition._step(trial, incumbent, last.sample, last.loads, True)
        assert (trial.judged is None) is jumped
    assert trial.judged is not None and trial.judged.model is incumbent.model


def test_no_payload_changes_on_a_clean_arm_of_500_hz() -> None:
    # Its walk led by 57 nats after 3.5 s, 50 of them for parts that it seemed to have learnt.
    case = replace(draw_case(None, 109, 'quanser_2dsfl', duration_s=10.05),
                   simulator='finite_elements')
    record = make_record(case)
    estimator = RecursivePredictionError(load_robot('quanser_2dsfl'))
    outputs = np.column_stack([record.joint, record.strain])
    command = np.vstack([np.zeros((1, 2)), record.command[:-1]])
    for time, output, before in zip(record.time[:1850], outputs, command):
        answer = estimator.update(float(time), output, before)
    assert estimator.incumbent.age > 3.0
    assert abs(answer.mass - case.payload_true) < answer.variance**0.5


def test_beside_coarse_no_exact_model_is_on_trial() -> None:
    """Its table said that a window pass leads from one to the other."""
    competition, coarse = estimator_of()._competition, of_mode(COARSE)
    coarse.passes = 3
    assert transitions.modes_to_try(coarse) == [ROUGH]
    assert not transitions.exact_can_be_searched(coarse)
    competition.keep(of_mode(EXACT), 0.0)
    trial = Trial('mode', coarse, 0.0, 0.1)
    competition.trials.append(trial)
    assert competition._promote(trial, of_mode(ROUGH), 1.0) is coarse
    assert [other.kalman.mode for other in competition.trials] == [ROUGH]
