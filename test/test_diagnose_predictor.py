"""The diagnosis' one-step predictor and what a record would have shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from flex_plant_sim.compiled import COMPILED
from flex_plant_sim.diagnosis.held_out.allowance import model_error
from flex_plant_sim.diagnosis.held_out.candidate_pass import Data, Round
from flex_plant_sim.diagnosis.held_out.detection import detection_limits
from flex_plant_sim.diagnosis.held_out.fit import explore, Fit, Projector, promise, settle
from flex_plant_sim.diagnosis.held_out.gain import autoregression, innovations
from flex_plant_sim.diagnosis.held_out.hypothesis import hypotheses
from flex_plant_sim.diagnosis.held_out.problem import GAUGES_ALONE
from flex_plant_sim.diagnosis.held_out.ranking import rank
from flex_plant_sim.diagnosis.held_out.verdict import cause_of
from flex_plant_sim.diagnosis.prediction import passage
from flex_plant_sim.diagnosis.prediction.predictor import Base, Predictor
from flex_plant_sim.effects import catalogue
from flex_plant_sim.effects.base import Effect
import numpy as np
import pytest
from simulated_records import effects, predictor, REFERENCE, simulated

GAPS = ('backlash:joint_1:gap_rad=0.01,sensor_behind_gear=0,hub_share=0.1',
        'backlash:joint_2:gap_rad=0.006,sensor_behind_gear=1,hub_share=0.05')


def first_fit(base: Base, hidden: Sequence[Effect], label: str) -> tuple[Fit, Fit, Data]:
    """Return a hypothesis's first fit to a record with hidden effects, the base's, the data."""
    data = Data.of([simulated(hidden, 28.0)], base)
    problem, fitted = settle(base, data.windows, data.noise)
    hypothesis, = (h for h in hypotheses(REFERENCE) if h.label == label)
    projector = Projector(problem, fitted.weighting)
    promised = promise(problem, hypothesis, projector, data.duration)
    return explore(problem, promised, projector), fitted, data


@pytest.mark.skipif(not COMPILED, reason='Numba is not installed: there is nothing to compare')
@pytest.mark.parametrize('more', [
    (), ('coulomb_friction:joint_2:level_n_m=0.3',),
    ('presliding_friction:joint_2:level_n_m=0.3,travel_rad=0.005',),
    ('strain_filter:arm:time_constant_s=0.02,damping=0.8',)])
def test_compiled_gaps_open_and_close_as_step_by_step(
        more: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    p, hidden = predictor(simulated(duration=24.0), locked=False), effects(*GAPS, *more)
    fast = p.innovations(hidden)
    monkeypatch.setattr(passage, 'COMPILED', False)
    slow = p.innovations(hidden)
    moved = np.max(np.abs(slow - p.innovations()), axis=(0, 1, 2))
    # One opens at the angle of the base's trajectory, the other at that of its own state.
    assert np.all(np.max(np.abs(fast - slow), axis=(0, 1, 2)) < 0.003 * moved)


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
                  p.noise, judging=True).innovations()[0]
        for r, hidden in ((record, ()), (replace(record, output=delayed),
                                         ('strain_delay:arm:delay_s=0.03',))))
    # Loads are judged by the record's own spread, which lacks its last three samples.
    assert np.all(np.std(found - own, axis=(0, 1)) < 0.001 * np.std(own, axis=(0, 1)))


def test_gauges_err_by_the_model_error_that_is_allowed_for() -> None:
    p = predictor(simulated(), locked=False)
    judge = Predictor(replace(p.base, discrepancy=GAUGES_ALONE), p.windows, p.noise,
                      judging=True)
    arm, first = judge.arm, judge.arm.own_states
    f = arm.schedule.table[0].reshape(arm.states, -1)[first:, first:arm.states]
    step = judge.discrepancy.step_variance(arm, p.record, GAUGES_ALONE)[first:]
    assert not step[:2].any()
    assert f == pytest.approx(np.diag(np.diagonal(f)), abs=1e-12)
    assert (step / (1.0 - np.diagonal(f)**2))[2:] == pytest.approx(
        model_error([p.record])[2:], rel=1e-9)
    assert arm.output_matrix[2:, first + 2:] == pytest.approx(np.eye(4))


def test_innovations_of_an_autoregression_are_what_drove_it() -> None:
    rng = np.random.default_rng(3)
    drive, residual = rng.standard_normal((2, 20, 500, 2))
    first, second = np.array([[0.9, 0.1], [0.0, 0.5]]), np.array([[-0.3, 0.0], [0.2, 0.1]])
    for k in range(2, residual.shape[1]):
        residual[:, k] = residual[:, k - 1] @ first + residual[:, k - 2] @ second + drive[:, k]
    found = innovations(residual, autoregression(residual))
    assert np.std(found - drive[:, 2:]) < 0.03


def test_a_first_fit_reaches_a_brake_far_stronger_than_the_drive_s_damping() -> None:
    hidden = effects('viscous_friction:joint_1:damping_n_m_s=30')
    fit, _, _ = first_fit(Base(REFERENCE), hidden, 'viscous_friction:joint_1')
    assert fit.values[0] == pytest.approx(30.0, rel=0.03)


def test_a_limit_is_what_base_parameters_cannot_undo() -> None:
    base = Base(REFERENCE, effects=(catalogue()['coriolis_centripetal']('arm', (1.0,)),))
    data = Data.of([simulated(base.effects, 28.0)], base)
    problem, fitted = settle(base, data.windows, data.noise)
    limits = detection_limits(problem, fitted, data.allowed, data.duration)
    # Three tolerances of stiffness belong to the base, less what their prior costs.
    for link in ('link_1', 'link_2'):
        assert limits[f'link_stiffness:{link}'][0] > 2.0 * REFERENCE.tolerances.stiffness
    # A gauge picks up nothing of itself; of the other three, the one that shows least decides.
    assert all(0.01 < limits[f'strain_crosstalk:{gauge}'][0] < 1.0
               for gauge in REFERENCE.gauge_names)


def test_a_cause_that_may_as_well_be_absent_is_not_stated_surely() -> None:
    hidden = effects('strain_delay:arm:delay_s=0.03')
    fit, fitted, data = first_fit(Base(REFERENCE), hidden, 'strain_delay:arm')
    # The same fit with columns that tell a hundred thousandth: nothing is known of its size.
    for found, most in ((fit, 1.0), (replace(fit, columns=1e-5 * fit.columns), 0.5)):
        ranked, = rank([found], fitted, data.noise, data.allowed)
        cause = cause_of(ranked, Round(fitted, (ranked,), ranked))
        value = cause.parameters[0]
        assert cause.probability == most
        assert (value.low > 0.0) == (most == 1.0)


def test_a_count_of_modes_is_not_doubted_for_want_of_a_slope() -> None:
    fit, fitted, data = first_fit(Base(REFERENCE, 'paper', 1), (), 'modal_truncation:arm')
    ranked, = rank([fit], fitted, data.noise, data.allowed)
    cause = cause_of(ranked, Round(fitted, (ranked,), ranked))
    assert ranked.relevant and cause.probability == 1.0


def test_nothing_to_rank_gives_an_empty_ranking() -> None:
    _, fitted, data = first_fit(Base(REFERENCE), (), 'strain_delay:arm')
    assert rank([], fitted, data.noise, data.allowed) == []
