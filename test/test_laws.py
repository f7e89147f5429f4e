"""A torque that no effect has, in arms of finite elements: its law competes with causes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
import json
from pathlib import Path
from typing import Any

from flex_payload_estimator.tools.diagnose import main
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.fit import NOTABLE_EXCESS
from flex_plant_sim.diagnosis.causes.free_run_ranking import (
    free_run_log_likelihoods,
    free_run_score,
    ranked_by_free_runs,
)
from flex_plant_sim.diagnosis.causes.gauss_newton import fit_set
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses, CauseSet
from flex_plant_sim.diagnosis.causes.look_alikes import different_optima
from flex_plant_sim.diagnosis.causes.posterior import Posterior, SetKey
from flex_plant_sim.diagnosis.causes.proposal_step import probe_catalogue
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.causes.refinement import remaining_torque_shares, try_laws
from flex_plant_sim.diagnosis.causes.search import ranked_with_laws
from flex_plant_sim.diagnosis.causes.search_state import SearchState
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
from flex_plant_sim.diagnosis.prediction.law import FOLDS, LatentSeries, Law, law_of, STRETCHES
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base, slowest_frequency
from flex_plant_sim.effects import catalogue, effects_of
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.joint.measured_torque import MeasuredTorque
import numpy as np
import pytest
from scipy.signal import bilinear, lfilter
from scipy.stats import norm
from truth.effects.hidden_effect import Parameters
from truth.records import FINITE_ELEMENTS, make_record, TruthCase
from truth.records import Record as TrueRecord

# What is hidden beside, and what imitates a brake.
ASKED = ('strain_gain', 'viscous_friction', 'actuator_gain', 'modal_damping', 'coulomb_friction',
         'stribeck_friction')
GAUGE: tuple[str, Parameters] = ('strain_gain', {'gauge': 3, 'factor': 0.8})
# Less friction at rest than in motion, N m and rad/s, as of what slides in a lubricant: the
# catalogue has but more of it at rest.
LEVEL, SPEED = 0.8, 0.12
BRAKE: tuple[str, Parameters] = ('stribeck_friction', {
    'joint': 2, 'sliding': LEVEL, 'extra': -LEVEL, 'speed': SPEED})
# Time constant of slow amplifiers, s.
SLOW = 0.06


def told(folder: Path, *hidden: tuple[str, Parameters], payload: float = 0.1,
         asked: Sequence[str] = ASKED, modes: int = 2, seconds: float = 18.0
         ) -> tuple[Any, tuple[Effect, ...]]:
    """Return what flex_diagnose says of a record, and the extended robot's effects."""
    log, answer, robot = (folder / name for name in ('log.csv', 'answer.json', 'robot.yaml'))
    make_record(TruthCase(91, hidden, payload_true=payload, duration_s=seconds,
                          simulator=FINITE_ELEMENTS)).write_csv(log)
    others = [f'--exclude={name}' for name in catalogue() if name not in asked]
    assert main([str(log), '--jobs', '1', '--modes', str(modes), '--payload', '0.1',
                 '--json', str(answer), '--extended', str(robot), *others]) == 0
    return json.loads(answer.read_text()), effects_of(load_robot(robot))


@pytest.mark.parametrize('torque', [0.0, 0.4])
def test_a_slow_torque_of_a_joint_shows_though_no_single_step_does(torque: float) -> None:
    """A wave of 1.3 rad: told nothing wrong, while joint 1 erred by 1.5 degrees in 5 s."""
    wave: tuple[str, Parameters] = (
        'torque_ripple', {'joint': 1, 'order': 5.0, 'phase': 0.5, 'torque': torque})
    true = make_record(TruthCase(91, (wave,) if torque else (), payload_true=0.1,
                                 duration_s=24.0, simulator=FINITE_ELEMENTS))
    robot = load_robot('reference')
    base = nominal_base(robot, 'assumed_modes', 2)
    record = Record('', true.time, true.command, np.hstack([true.joint, true.strain]), 0.1)
    data = Data.of([record], slowest_frequency(base, record.payload), robot.sample_time)
    fit = fit_set(Likelihood(base, data.windows, data.noise), CauseSet((), data.duration),
                  (np.zeros(0),))
    assert np.all(fit.error_scale < NOTABLE_EXCESS)
    assert Posterior.of([fit], base).best.discrepancy.remainder == bool(torque)
    assert (np.argmax(fit.slow_scale) == 0) == bool(torque)


def test_a_law_takes_the_place_of_causes_that_imitate_it(tmp_path: Path) -> None:
    found, effects = told(tmp_path, GAUGE, BRAKE, modes=3, seconds=22.0)
    cause, = found['causes']
    assert (cause['name'], cause['site']) == ('strain_gain', 'strain_2a')
    assert cause['parameters']['factor']['value'] == pytest.approx(0.8, abs=0.02)
    assert found['verdict'] == 'cause_and_remainder' and found['probabilities']['unknown'] > 0.9
    law = found['latent']['after']['joint_2']['law']
    assert law['stated'] and law['variable'] == 'speed'
    # The extended robot brakes as the arm does, and runs freely for it where it was not fitted.
    table, = (e for e in effects if isinstance(e, MeasuredTorque) and e.site == 'joint_2')
    speed = np.array([-0.9, -0.6, -0.3, 0.3, 0.6, 0.9])
    true = -np.sign(speed) * LEVEL * (1.0 - np.exp(-(speed / SPEED)**2))
    np.testing.assert_allclose(np.interp(speed, *table.table), true, rtol=0.0, atol=0.1)
    gain = found['gain']['joint_2']
    assert gain['ratio_high'][gain['horizon_s'].index(2.0)] < 0.2


def test_a_cause_is_more_probable_than_a_law_that_does_the_same(tmp_path: Path) -> None:
    viscous: tuple[str, Parameters] = ('viscous_friction', {'joint': 2, 'coefficient': 3.0})
    found, _ = told(tmp_path, GAUGE, viscous)
    assert {cause['name'] for cause in found['causes']} == {GAUGE[0], viscous[0]}
    assert found['verdict'] == 'cause'


def test_a_cause_takes_the_place_of_its_law_beside_a_wrong_payload(tmp_path: Path) -> None:
    """Alone, friction is hidden behind the payload that is not as told, and that behind parts."""
    friction: tuple[str, Parameters] = ('coulomb_friction', {'joint': 1, 'torque': 1.9})
    found, _ = told(tmp_path, friction, payload=0.14,
                    asked=('payload_mass', 'coulomb_friction', 'link_stiffness'))
    causes = {cause['name']: cause['parameters'] for cause in found['causes']}
    assert set(causes) == {'payload_mass', 'coulomb_friction'} and found['verdict'] == 'cause'
    assert causes['coulomb_friction']['level_n_m']['value'] == pytest.approx(1.9, abs=0.15)
    assert causes['payload_mass']['deviation_kg']['value'] == pytest.approx(0.04, abs=0.01)


def test_a_set_without_a_law_may_miss_no_more_than_every_model() -> None:
    laws = tuple(MeasuredTorque(f'joint_{k}', ('speed', (0.0, 1.0), (0.0, float(k))))
                 for k in (1, 2))
    told = DiscrepancyModel(torque_share=(0.05, 0.07), laws=laws, law_penalties=(3.0, 4.0))
    one = told.without_law(laws[0])
    assert one == DiscrepancyModel(torque_share=(0.06, 0.07), laws=laws[1:], law_penalties=(4.0,))
    assert one.without_law(laws[1]) == DiscrepancyModel()


def test_a_knot_pays_the_occam_factor_of_laplace_s_method() -> None:
    """The integral of a Gaussian likelihood over a Gaussian prior, by quadrature."""
    size, deviation = 1.5, 0.04
    law = Law('joint_1', 'speed', 'rad/s', np.zeros(1), np.ones(1), np.array([deviation]),
              0.9, 0.01, size, True, True)
    value = np.linspace(-8.0, 8.0, 400001) * size
    prior = np.exp(-0.5 * (value / size)**2) / (size * np.sqrt(2.0 * np.pi))
    likelihood = np.exp(-0.5 * (value / deviation)**2)
    mean = float(np.sum(prior * likelihood) * (value[1] - value[0]))
    assert law.occam_penalty == pytest.approx(-np.log(mean), rel=1e-6)


def test_a_joint_that_moves_in_every_fifth_stretch_has_a_law() -> None:
    rng, count = np.random.default_rng(7), 100 * STRETCHES
    moving = np.arange(count) // 100 % FOLDS == 0
    speed = rng.uniform(-1.0, 1.0, count)
    torque = np.tanh(4.0 * speed) + 0.01 * rng.normal(size=count)
    law = law_of(LatentSeries('joint_1', 'N m', torque, np.full(count, 0.01),
                              {'speed': ('rad/s', speed)}, moving, 0.01))
    assert law.stated and law.variable == 'speed'


@cache
def braked_record() -> TrueRecord:
    """Return the record of a braked arm of elements."""
    return make_record(TruthCase(93, (BRAKE,), duration_s=15.0, simulator=FINITE_ELEMENTS))


def braked_data(base: BaseModel, amplifier: Callable[[Array], Array] = np.asarray) -> Data:
    """Return the windows of a braked arm of elements, whose strain passes an amplifier."""
    made = braked_record()
    record = Record('braked', made.time, made.command,
                    np.hstack([made.joint, amplifier(made.strain)]), 0.1)
    return Data.of([record], slowest_frequency(base, record.payload), base.robot.sample_time)


def braked(torque: tuple[float, float]) -> tuple[RefinedFit, Data, BaseModel]:
    """Return nothing fitted to a braked arm of elements, told how large its torques may be."""
    base = replace(nominal_base(load_robot('reference'), 'assumed_modes', 2),
                   discrepancy=DiscrepancyModel(torque_share=torque))
    data = braked_data(base)
    return RefinedFit.refine(CandidateSet((), (np.zeros(0),)), base, data), data, base


@pytest.fixture(scope='module')
def braked_as_stated() -> tuple[RefinedFit, Data, BaseModel]:
    """Return nothing fitted to a braked arm, told the torques of any arm."""
    return braked(DiscrepancyModel().torque_share)


def test_a_torque_without_a_name_is_a_torque_and_no_noise_of_its_sensor(
        braked_as_stated: tuple[RefinedFit, Data, BaseModel]) -> None:
    stated, scaled = DiscrepancyModel().torque_share, braked_as_stated[0].fit
    assert scaled.error_scale[1] > NOTABLE_EXCESS
    told = braked(remaining_torque_shares(scaled))[0].fit
    assert remaining_torque_shares(scaled)[1] == pytest.approx(stated[1] * scaled.error_scale[1])
    # Errors are as small as stated then, and likelier for it.
    assert told.error_scale[1] < 1.0 + 0.5 * (scaled.error_scale[1] - 1.0)
    assert told.log_evidence > scaled.log_evidence + 10.0


def test_sets_with_laws_are_told_apart_by_their_free_runs_not_one_step_ahead(
        braked_as_stated: tuple[RefinedFit, Data, BaseModel]) -> None:
    found, data, base = braked_as_stated
    # Drives a half stronger and links a fifth softer, which one step ahead is told to like.
    wrong = np.array([{'drive_gain_2': 0.5, 'stiffness_1': -0.2, 'stiffness_2': -0.2}.get(
        part.name, 0.0) for part in found.likelihood.parts])
    liked = replace(found, fit=replace(found.fit, deviations=found.fit.deviations + wrong,
                                       log_evidence=found.fit.log_evidence + 100.0))
    sets = [liked, found]
    best, posterior = ranked_by_free_runs(
        sets, free_run_log_likelihoods(sets, data, base, 1), base)
    np.testing.assert_array_equal(best.fit.deviations, found.fit.deviations)
    assert posterior.best is best.fit and posterior.probability[0] > 0.9


def test_sets_whose_models_all_diverge_are_as_likely_as_before(
        braked_as_stated: tuple[RefinedFit, Data, BaseModel],
        monkeypatch: pytest.MonkeyPatch) -> None:
    found, data, base = braked_as_stated
    monkeypatch.setattr('flex_plant_sim.diagnosis.causes.free_run_ranking.free_run_rms',
                        lambda model, data: np.array([[np.inf]]))
    sets, shares = [found, found], list[float]()
    _, posterior = ranked_by_free_runs(
        sets, free_run_log_likelihoods(sets, data, base, 1, shares.append), base)
    assert shares == [0.5, 1.0]
    np.testing.assert_allclose(posterior.probability, 0.5)


def test_a_slow_gauge_is_found_beside_laws_from_a_late_one() -> None:
    """Beside laws evidence liked the late gauge, and the slow one was not refined."""
    base = nominal_base(load_robot('reference'), 'assumed_modes', 2)
    filtered = bilinear([1.0], [SLOW**2, 2.0 * 0.5 * SLOW, 1.0], 1.0 / base.robot.sample_time)
    data = braked_data(base, lambda strain: lfilter(*filtered, strain, axis=0))
    state = SearchState(data, base, 1, [
        name for name in catalogue() if not name.startswith('strain')], lambda step, share: None)
    nothing = state.refine(CandidateSet((), (np.zeros(0),)), base.discrepancy)
    probe_catalogue(state, nothing)
    try_laws(state, nothing)
    laws = state.best.fit.discrepancy
    assert laws.laws
    late, slow = (next(h for h in state.catalogue if h.label == label)
                  for label in ('strain_delay:arm', 'strain_filter:arm'))
    state.refine(CandidateSet((late,), (np.array([SLOW]),)), laws)
    # The slow gauge is known, at an optimum of which evidence is sure and that runs badly.
    wrong = state.refine(CandidateSet((slow,), (np.array([SLOW, 0.5]),)), laws)
    wrong = replace(wrong, fit=replace(wrong.fit, values=np.array([0.2 * SLOW, 1.7]),
                                       log_evidence=wrong.fit.log_evidence + 300.0))
    state.refined[SetKey.of(wrong.fit)] = wrong
    best = ranked_with_laws(state, nothing).best
    assert [h.label for h in best.fit.hypotheses] == ['strain_filter:arm']
    np.testing.assert_allclose(best.fit.values, [SLOW, 0.5], rtol=0.2)


def test_starts_that_end_within_a_deviation_are_one_optimum(
        braked_as_stated: tuple[RefinedFit, Data, BaseModel]) -> None:
    found, _, base = braked_as_stated
    late = next(h for h in all_hypotheses(base.robot) if h.label == 'strain_delay:arm')
    ends = [replace(found.fit, hypotheses=(late,), values=np.array([delay]),
                    covariance=np.diag([1e-6, *np.diag(found.fit.covariance)]))
            for delay in (0.02, 0.0205, 0.05, 0.0209)]
    assert [fit.values[0] for fit in different_optima([*ends, found.fit])[:-1]] == [0.02, 0.05]


def test_a_free_run_is_scored_by_the_likelihood_of_errors_of_unknown_scale() -> None:
    """The ratio of two Gaussian likelihoods, each at its most likely scale, by logpdf."""
    rng, windows = np.random.default_rng(5), 40
    errors = rng.normal(size=(windows, 2)) * [1e-3, 1e-6]
    rms = np.sqrt(np.mean(errors**2, axis=0))
    worse = rms * [3.0, 1.0]

    def most_likely(factor: Array) -> float:
        return float(np.sum(norm.logpdf(factor * errors, scale=factor * rms)))

    one, other = (free_run_score(np.array([r, r]), windows) for r in (rms, worse))
    expected = most_likely(np.ones(2)) - most_likely(worse / rms)
    assert one - other == pytest.approx(expected, rel=1e-12)
    # Only one of two horizons is worse: half of it.
    half = free_run_score(np.array([rms, worse]), windows)
    assert one - half == pytest.approx(0.5 * (one - other), rel=1e-12)
    assert free_run_score(np.array([[1.0, np.inf]]), windows) == -np.inf
