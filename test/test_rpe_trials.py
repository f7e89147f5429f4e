"""What decides between hypotheses of the recursive-prediction-error estimator, one rule each."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.evidence import rare
from flex_payload_estimator.estimators.rpe.hypothesis import (
    EXACT,
    Filter,
    Mode,
    MODES,
    PARTS,
    ROUGH,
)
from flex_payload_estimator.estimators.rpe.trial import Trial
from flex_plant_sim.simulation.payload_profile import PayloadProfile
import numpy as np
import pytest
from rpe_runs import estimator_of, Run

COARSE = MODES[2]


def of_mode(mode: Mode, age: float = 9.0) -> Filter:
    """Return a filter that has learnt in motion for so long, s."""
    f = estimator_of().stepper.begin(mode, np.zeros(6), 0.1, 0.1)
    f.age = age
    return f


@pytest.mark.parametrize(('kind', 'mode', 'learnt', 'age', 'settles'), [
    # An exact one that begins afresh: from then on, however long the modes have differed.
    ('other', EXACT, 0.05, 9.0, True), ('other', EXACT, 0.15, 0.0, False),
    ('other', PARTS, 0.05, 0.0, False), ('other', COARSE, 0.05, 0.0, False),
    # A payload that stands still: from when the trial began.
    ('still', EXACT, 9.0, 0.05, True), ('still', EXACT, 0.05, 0.15, False),
    ('still', ROUGH, 9.0, 0.05, True), ('moved', EXACT, 0.05, 0.05, False)])
def test_who_begins_afresh_settles_for_a_tenth_of_a_second(
        kind: str, mode: Mode, learnt: float, age: float, settles: bool) -> None:
    assert Trial(kind, of_mode(mode, learnt), 0.0, 0.1, age=age).settles is settles


def test_what_a_trial_loses_while_it_settles_does_not_count() -> None:
    estimator = estimator_of()
    Run(estimator, PayloadProfile.constant(0.15), 0.4)
    modes, exact = estimator._modes, estimator.incumbent.copy()
    rough, last = of_mode(ROUGH), modes.past[modes.past.end - 1]
    # So likely as no exact one is.
    rough.gained = 1e6
    for learnt, counts in ((0.0, False), (0.5, True)):
        exact.age = learnt
        trial = Trial('other', exact.copy(), 0.0, 0.1)
        modes._step(trial, rough, last.sample, last.loads, True)
        assert (trial.gain < 0.0) is counts


@pytest.mark.parametrize(('former', 'mode', 'counts'), [
    (EXACT, ROUGH, True), (ROUGH, COARSE, True), (COARSE, ROUGH, False), (ROUGH, EXACT, False)])
def test_a_wronger_model_counts_in_noise_that_hides_its_error(
        former: Mode, mode: Mode, counts: bool) -> None:
    # It gained 40 nats on an arm of other parts, and won 2 s later, when that moved faster.
    estimator = estimator_of()
    Run(estimator, PayloadProfile.constant(0.15), 0.5)
    modes, incumbent = estimator._modes, of_mode(former)
    last = modes.past[modes.past.end - 1]
    incumbent.record[:6] = 1e8
    trial = Trial('other', of_mode(mode), 0.0, 0.1, gain=40.0)
    modes._step(trial, incumbent, last.sample, last.loads, True)
    assert trial.gain > 0.0 and (trial.age > 0.0) is counts


@pytest.mark.parametrize(('mode', 'noise', 'age', 'wins'), [
    (COARSE, 1.0, 0.1, False), (COARSE, 1.0, 0.3, True), (COARSE, 3.9, 0.3, True),
    # A burst of noise, which looks like a wronger model until it is over.
    (COARSE, 4.1, 0.3, False), (COARSE, 4.1, 0.9, False), (COARSE, 4.1, 1.0, True),
    (ROUGH, 3.9, 0.3, True), (ROUGH, 4.1, 0.9, False), (ROUGH, 4.1, 1.0, True)])
def test_where_the_noise_has_grown_no_model_is_soon_wrong(
        mode: Mode, noise: float, age: float, wins: bool) -> None:
    estimator = estimator_of()
    Run(estimator, PayloadProfile.constant(0.15), 1.2)
    modes, incumbent = estimator._modes, of_mode(ROUGH if mode == COARSE else EXACT)
    for moment in modes.past._moments:
        moment.noise = np.ones(6)
    incumbent.record[:6] = noise
    trial = Trial('other', of_mode(mode), 0.0, 0.1, gain=1e3, age=age)
    assert modes._wins(trial, incumbent) is wins
    # What is given back after it was a burst's, which by the time in motion may be just over.
    trial.best = 1e3 + 1.1 * rare(estimator.stepper.step_time)
    assert modes._wins(trial, incumbent) is (wins and noise < 4.0)
    trial.begin(0.0)
    assert trial.best == trial.gain == 0.0


def test_a_burst_counts_as_long_as_it_is_ago_however_little_the_arm_moved() -> None:
    # Where modes hardly differ a trial ages slower than time passes.
    estimator = estimator_of()
    Run(estimator, PayloadProfile.constant(0.15), 1.2)
    modes, incumbent = estimator._modes, of_mode(ROUGH)
    for moment in modes.past._moments:
        moment.noise = np.full(6, 100.0 if moment.sample.time > 0.5 else 1.0)
    incumbent.record[:6] = 100.0
    for since, wins in ((0.4, False), (0.8, True)):
        trial = Trial('other', of_mode(COARSE), since, 0.1, gain=1e3, age=0.3)
        assert modes._wins(trial, incumbent) is wins
