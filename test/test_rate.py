"""Records that are sampled faster than a diagnosis needs, and events at times of any grid."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from flex_payload_estimator.tools.diagnose import main
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses
from flex_plant_sim.diagnosis.causes.proposal import Proposal
from flex_plant_sim.diagnosis.causes.sensitivity import SensitivityProbe, TIMES_A_PERIOD
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.verdict import predictors, prepared
from flex_plant_sim.effects import catalogue
import numpy as np
import pytest
from simulated_records import effects, REFERENCE, simulated, SLOWEST, write

FAST = replace(REFERENCE, sample_time=0.001)
CHANGE, = (h for h in all_hypotheses(REFERENCE) if h.label == 'payload_change:arm')


def test_of_a_fast_record_as_many_samples_are_kept_as_a_slow_one_has() -> None:
    time = 0.001 * np.arange(1004.0)
    lost = np.where(np.arange(1004) == 12, 1.0, 0.0)
    fast = Record('fast', time, np.column_stack([time, -time]), np.column_stack(4 * [time]), 0.1,
                  lost)
    (kept,), nominal = prepared([fast], BaseModel(FAST))
    # The slowest mode has 0.798 s with 0.1 kg, so that one sample in 12 leaves 66, in 13 too few.
    assert nominal.robot.sample_time == pytest.approx(0.012)
    assert kept.time == pytest.approx(0.012 * np.arange(83))
    assert kept.command[:, 0] == pytest.approx(kept.time + 0.0055), 'the mean of twelve'
    assert kept.output[:, 3] == pytest.approx(kept.time)
    assert np.flatnonzero(np.isnan(kept.measured[:, 0])).tolist() == [1]


@pytest.mark.parametrize('heavy', [0.0, 0.1, 0.28])
def test_a_record_of_a_hundred_samples_a_second_is_kept_whole(heavy: float) -> None:
    record = replace(simulated((), 5.0), payload=heavy)
    (kept,), nominal = prepared([record], BaseModel(REFERENCE))
    assert kept is record and nominal == BaseModel(REFERENCE)


def test_what_is_left_of_a_fast_record_is_predicted_to_its_noise() -> None:
    """Commands that step between two samples kept act by their mean."""
    record = simulated((), 22.0, robot=FAST)
    (kept,), nominal = prepared([record], BaseModel(FAST))
    data = Data.of([kept], SLOWEST, nominal.robot.sample_time)
    found, = predictors(nominal, data)
    deviation = np.sqrt(np.mean(found.innovations()**2, axis=(0, 1, 2)))
    assert np.all(deviation < 1.5 * np.r_[1e-4, 1e-4, 4 * [5e-7]])


def likelihood() -> Likelihood:
    """Return the likelihood of a clean record, with each arm's own filter."""
    data = Data.of([simulated((), 22.0)], SLOWEST, REFERENCE.sample_time)
    return Likelihood(BaseModel(REFERENCE), data.windows, data.noise).with_own_filters


@pytest.mark.parametrize('duration_s', [0.0, 3.0, 12.0])
def test_an_event_at_any_time_changes_what_the_sensitivity_says(duration_s: float) -> None:
    known, deviation = likelihood(), np.array([-0.02, 0.0, 0.0])
    found = [s for s in SensitivityProbe(known).sensitivities(CHANGE, deviation)
             if s.shape[2] == duration_s]
    times = np.array([s.shape[1] for s in found])
    # One time in each bin in which there are samples.
    bins = np.floor(np.unique(known.times) / (max(known.period, duration_s) / TIMES_A_PERIOD))
    assert np.all(np.isin(times, known.times)) and times.size == np.unique(bins).size
    nearest = found[int(np.argmin(np.abs(times - 6.0)))]
    exact = (known.residual((CHANGE.effect_at(nearest.shape + deviation),))
             - known.centre_residual).ravel()
    left = exact - nearest.changes[0]
    assert left @ left < 0.2 * exact @ exact


def test_an_event_is_started_at_all_times_within_half_a_period() -> None:
    start = np.array([-0.1, 6.0, 0.0])
    around = Proposal(CHANGE, 1.0, 0.0, (start, 2.0 * start), (), np.zeros(0), np.zeros(0)
                      ).with_times_around(0.8)
    times = np.array(around.starts)
    assert len(times) == 22 and set(times[:, 0]) == {-0.1, -0.2}
    assert times[:11, 1] == pytest.approx(np.linspace(5.6, 6.4, 11))
    early = Proposal(CHANGE, 1.0, 0.0, (np.array([-0.1, 0.2, 0.0]),), (), np.zeros(0), np.zeros(0)
                     ).with_times_around(0.8)
    assert np.array(early.starts)[:, 1].min() == 0.0, 'no event is before the record'


def test_an_event_that_is_known_is_where_a_fit_begins_too() -> None:
    """A coarse fit that lacks the window in which it was says another time."""
    lag, = (h for h in all_hypotheses(REFERENCE) if h.label == 'motor_lag:joint_1')
    coarse = CandidateSet((lag, CHANGE), (np.array([0.009, 1.0, -0.08, 15.0, 0.0]),))
    known = CandidateSet((CHANGE,), (np.array([-0.1, 21.05, 0.0]),))
    first, second = coarse.with_values_of(known).starts
    assert first is coarse.starts[0] and second == pytest.approx([0.009, 1.0, -0.1, 21.05, 0.0])


@pytest.mark.slow
def test_a_fast_log_is_told_as_a_slow_one_and_extends_the_file_as_it_is(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hidden = effects('viscous_friction:joint_2:damping_n_m_s=3')
    log = write(simulated(hidden, 14.0, robot=FAST), tmp_path / 'log.csv', FAST)
    asked = ('viscous_friction', 'strain_filter', 'payload_change')
    assert main([str(log), '--payload', '0.1', '--extended', str(tmp_path / 'robot.yaml'), *(
        f'--exclude={name}' for name in catalogue() if name not in asked)]) == 0
    said = capsys.readouterr().out
    assert '14000 samples, of which one in 12 is used: more tell noise alone' in said
    assert 'viscous friction, joint 2          88 %' in said
    extended = load_robot(str(tmp_path / 'robot.yaml'))
    assert extended.sample_time == REFERENCE.sample_time
    spec, = (s for s in extended.effects if s.name == 'viscous_friction')
    assert spec.values['damping_n_m_s'] == pytest.approx(3.0, rel=0.1)
