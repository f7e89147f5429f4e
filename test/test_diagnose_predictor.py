"""The diagnosis' one-step predictor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED
from flex_plant_sim.diagnosis.prediction import filter_run
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.filter_run import FilterRun
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.diagnosis.prediction.steady_filter import (
    predicted_covariance,
    steady_filter,
)
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from simulated_records import effects, predictor, REFERENCE, simulated

GAPS = ('backlash:joint_1:gap_rad=0.01,sensor_behind_gear=0,hub_share=0.1',
        'backlash:joint_2:gap_rad=0.006,sensor_behind_gear=1,hub_share=0.05')


@pytest.mark.skipif(not COMPILED, reason='Numba is not installed: there is nothing to compare')
@pytest.mark.parametrize('more', [
    (), ('coulomb_friction:joint_2:level_n_m=0.3',),
    ('presliding_friction:joint_2:level_n_m=0.3,travel_rad=0.005',),
    ('strain_filter:arm:time_constant_s=0.02,damping=0.8',),
    ('payload_change:arm:change_kg=-0.1,time_s=9,duration_s=0.3',)])
def test_compiled_gaps_open_and_close_as_step_by_step(
        more: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    p, hidden = predictor(simulated(duration=24.0), locked=False), effects(*GAPS, *more)
    fast = p.innovations(hidden)
    monkeypatch.setattr(filter_run, 'COMPILED', False)
    slow = p.innovations(hidden)
    moved = np.max(np.abs(slow - p.innovations()), axis=(0, 1, 2))
    # One opens at the angle of the base's trajectory, the other at that of its own state.
    assert np.all(np.max(np.abs(fast - slow), axis=(0, 1, 2)) < 0.003 * moved)


@pytest.mark.parametrize('side', [0, 1])
def test_a_known_gap_leaves_no_more_than_the_sensors_err(side: int) -> None:
    """Teeth meet between samples, and no torque of the drive reaches a link that is free."""
    true = effects(f'backlash:joint_2:gap_rad=0.012,sensor_behind_gear={side},hub_share=0.1')
    p = predictor(simulated(true, substeps=5), locked=False)
    comparing = Predictor(p.base, p.windows, p.noise, for_comparison=True, trajectory_effects=true)
    assert np.all(np.std(comparing.whitened_residual(true)[0], axis=(0, 1)) < 1.0)


def test_a_known_gap_is_predicted_with_a_payload_that_goes() -> None:
    """In some seconds, to nothing, where the arm changes the most with its payload."""
    true = effects('backlash:joint_2:gap_rad=0.012,sensor_behind_gear=0,hub_share=0.1',
                   'payload_change:arm:change_kg=-0.1,time_s=9,duration_s=2')
    p = predictor(simulated(true, substeps=5), locked=False)
    comparing = Predictor(p.base, p.windows, p.noise, for_comparison=True, trajectory_effects=true)
    assert np.all(np.std(comparing.whitened_residual(true)[0], axis=(0, 1)) < 1.0)


@pytest.mark.parametrize('hidden', [
    'payload_inertia:arm:inertia_kg_m2=0.006', 'hub_inertia:joint_2:inertia_kg_m2=0.05',
    'clamp_compliance:link_1:compliance_rad_per_n_m=0.025'])
def test_a_hypothesis_far_from_the_base_predicts_its_own_arm(hidden: str) -> None:
    true = effects(hidden)
    p = predictor(simulated(true), locked=False)
    own = p.innovations(true)[0]
    best = predictor(simulated(true), true, locked=False).innovations()[0]
    # The angle that schedules it is the base's; with the base's gain all three diverge.
    assert np.all(np.std(own, axis=(0, 1)) < 1.1 * np.std(best, axis=(0, 1)))


def test_a_late_gauge_is_predicted_as_if_it_were_in_time() -> None:
    record, late = simulated(), 3
    delayed = record.output.copy()
    delayed[late:, 2:] = record.output[:-late, 2:]
    p = predictor(record, locked=False)
    own, found = (
        Predictor(replace(p.base, effects=effects(*hidden)), replace(p.windows, record=r),
                  p.noise, for_comparison=True).innovations()[0]
        for r, hidden in ((record, ()), (replace(record, output=delayed),
                                         ('strain_delay:arm:delay_s=0.03',))))
    # Loads are judged by the record's own spread, which lacks its last three samples.
    assert np.all(np.std(found - own, axis=(0, 1)) < 0.001 * np.std(own, axis=(0, 1)))


@pytest.mark.parametrize('hidden, reading', [
    ('angle_offset:joint_2:offset_rad=0.2', lambda angle: angle + 0.2),
    ('angle_gain:joint_2:factor=1.2', lambda angle: 1.2 * angle)])
def test_an_arm_begins_where_its_sensors_mean_it(
        hidden: str, reading: Callable[[Array], Array]) -> None:
    record = simulated()
    away = replace(record, output=record.output + [0.0, 0.4, 0.0, 0.0, 0.0, 0.0])
    misread = away.output.copy()
    misread[:, 1] = reading(away.output[:, 1])
    p = predictor(record, locked=False)
    own, found = (Predictor(replace(p.base, effects=effects(*e)), replace(p.windows, record=r),
                            p.noise).states for e, r in (
        ((), away), ((hidden,), replace(record, output=misread))))
    assert found[0] == pytest.approx(own[0], abs=1e-9)
    # Before the filter has seen anything, and while it forgets its start.
    assert np.max(np.abs(found[:200, :2] - own[:200, :2])) < 1e-3


@pytest.mark.parametrize('late', ['angle_delay:joint_1:delay_s={}', 'strain_delay:arm:delay_s={}',
                                  'motor_lag:joint_1:time_constant_s={},inside_loop=0'])
def test_a_little_lateness_changes_little(late: str) -> None:
    # From a state of zero, a delayed angle would jump to where the arm is.
    p = predictor(simulated(), locked=False)
    comparing = Predictor(p.base, p.windows, p.noise, for_comparison=True)
    clean = comparing.whitened_residual()
    small, large = (comparing.whitened_residual(effects(late.format(size))) - clean
                    for size in (2e-4, 2e-3))
    assert np.std(10.0 * small - large) < 0.2 * np.std(large)


def test_a_gauge_whose_gain_creeps_is_predicted_as_if_it_did_not() -> None:
    record = simulated()
    crept = record.output.copy()
    crept[:, 2] *= 1.0 + 0.005 * record.time
    p = predictor(record, locked=False)
    hidden = effects('strain_gain:strain_1a:factor=1,creep_per_s=0.005')
    right, creeping = (Predictor(p.base, replace(p.windows, record=r), p.noise,
                                 trajectory_effects=e)
                       for r, e in ((record, ()), (replace(record, output=crept), hidden)))
    own, found = right.innovations()[0], creeping.innovations(hidden)[0]
    # Loads are judged by the record's spread, of which the creep is a part.
    assert np.all(np.std(found - own, axis=(0, 1)) < 0.05 * np.std(own, axis=(0, 1)))
    # A reading errs by its gain times as much.
    own, found = (q.whitened_residual(h, shared_covariance=False)[0, ..., 2]
                  for q, h in ((right, ()), (creeping, hidden)))
    gain = 1.0 + 0.005 * record.time[p.windows.indices[:, p.windows.warm_up:]]
    ratio = np.sum(found * own, axis=1) / np.sum(own**2, axis=1)
    np.testing.assert_allclose(ratio / ratio[0], (gain / gain[0]).mean(axis=1), rtol=0.03)
    assert ratio[-1] > 1.05 * ratio[0]


def test_arms_start_where_a_trajectory_with_other_coordinates_puts_them() -> None:
    fast = effects('coriolis_centripetal:arm:share=1')
    p = predictor(simulated(fast), fast, locked=False)
    own = np.std(p.innovations()[0], axis=(0, 1))
    for other in ('base_compliance:arm:compliance_rad_per_n_m=0.003,inertia_kg_m2=0.1',
                  'loose_payload:arm:compliance_m_per_n=0.01,damping_ratio=0.05'):
        along = Predictor(p.base, p.windows, p.noise, trajectory_effects=effects(other))
        assert np.all(np.std(along.innovations()[0], axis=(0, 1)) < 1.2 * own)


def test_steady_filter_solves_the_riccati_equation() -> None:
    arm = BaseModel(REFERENCE).arm(REFERENCE.payload_mass)
    noise = np.array([1e-4, 1e-4, 5e-7, 5e-7, 5e-7, 5e-7])
    force = np.full(arm.form.order, 1e-4)
    steady, n = steady_filter(arm, force, noise), arm.states
    # At an end of the schedule, where a Riccati equation is solved itself.
    table, c = arm.schedule.table[0].reshape(n, -1), arm.output_matrix
    f, e = table[:, :n], table[:, n + 2:]
    p = solve_discrete_are(f.T, c.T / noise, (e * force) @ e.T, np.eye(noise.size))
    s = c @ p @ c.T + np.diag(noise**2)
    assert steady.gain[0] == pytest.approx(f @ p @ c.T @ np.linalg.inv(s), rel=1e-5, abs=1e-9)
    whitened = steady.whitener[0] @ s @ steady.whitener[0].T
    assert whitened == pytest.approx(np.eye(noise.size), abs=1e-5)


@pytest.mark.parametrize('growth', [1.0, 1.1])
def test_a_mode_that_no_output_shows_has_no_steady_filter(growth: float) -> None:
    """It had a covariance of 2^24 samples, or an infinite one."""
    c = np.array([[1.0, 0.0]])
    f = np.array([np.diag([0.5, 0.9]), np.diag([0.5, growth])])
    shown, = predicted_covariance(f[:1], np.eye(2), c)
    assert shown == pytest.approx(solve_discrete_are(f[0].T, c.T, np.eye(2), np.eye(1)), rel=1e-12)
    with pytest.raises(np.linalg.LinAlgError, match='no finite prediction'):
        predicted_covariance(f, np.eye(2), c)


@pytest.mark.parametrize(('hidden', 'kept'), [
    ('motor_lag:joint_1:time_constant_s=0.01', True), ('modal_damping:link_1:factor=1.5', True),
    ('payload_mass:arm:deviation_kg=0.03', False),
    ('angle_offset:joint_2:offset_rad=0.01', False)])
def test_forces_are_kept_where_what_they_depend_on_is_equal(hidden: str, kept: bool) -> None:
    plain, base = predictor(simulated(duration=14.0), locked=False), nominal_base(
        REFERENCE, 'assumed_modes', 2)
    p = Predictor(base, plain.windows, plain.noise)
    arm = p.arm_with(effects(hidden))
    run, anew = (FilterRun(p, arm, p.matrices, p.used_samples, 1, like)
                 for like in (p.own_run, None))
    np.testing.assert_array_equal(run.drive, anew.drive)
    assert len(p.own_run.pushes) == 2
    assert all((run.pushes[k] is push) == kept for k, push in p.own_run.pushes.items())


def test_a_share_of_coriolis_forces_is_predicted_for_many_values_at_once() -> None:
    """It ended in an array of no shape."""
    full = predictor(simulated(duration=14.0), locked=False)
    p, shares = Predictor(BaseModel(REFERENCE), full.windows, full.noise), (0.3, 1.0)
    coriolis, = effects('coriolis_centripetal:arm:share=1')
    both = p.innovations([replace(coriolis, values=(np.array(shares)[:, None],))])
    each = [p.innovations([replace(coriolis, values=(share,))])[0] for share in shares]
    np.testing.assert_allclose(both, each, rtol=1e-9, atol=1e-15)
    assert np.abs(both[0] - both[1]).max() > 1e-5
