"""The search among sets of causes, on records of the package's own arm."""

from __future__ import annotations

from collections.abc import Mapping

from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.diagnosis.causes.gauss_newton import GaussNewton
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses, CauseSet, Hypothesis
from flex_plant_sim.diagnosis.causes.posterior import SetKey
from flex_plant_sim.diagnosis.causes.search import search, SearchResult
from flex_plant_sim.diagnosis.likelihood.prior import imitation_odds
from flex_plant_sim.diagnosis.pool import each
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.detection import (
    CLOSE,
    detection_limits,
    is_steep,
)
from flex_plant_sim.diagnosis.verdict.results import DetectionLimit
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base, slowest_frequency
from flex_plant_sim.effects import catalogue
import numpy as np
import pytest
from scipy.stats import norm
from simulated_records import effects, REFERENCE, simulated, SLOWEST
from truth.records import HAVE_MUJOCO, make_record, MUJOCO, NO_MUJOCO, TruthCase

# Friction and what imitates it while the gauge is wrong, too; what parts may undo; an event.
ASKED = ('viscous_friction', 'actuator_gain', 'strain_gain', 'link_stiffness', 'payload_change')
HIDDEN = ('viscous_friction:joint_2:damping_n_m_s=3', 'strain_gain:strain_2a:factor=0.8')
# Of these five effects: 412 to 414, of them 33 each time that the parts' Jacobian is taken.
MOST_PASSES = 420

# All but what something unknown leaves of a probability.
SURE = 0.99 / (1.0 + imitation_odds())
# Evenly in probability.
NORMAL = norm.ppf((np.arange(1000) + 0.5) / 1000)


def searched(hidden: tuple[str, ...], data: Data | None = None, asked: tuple[str, ...] = ASKED,
             base: BaseModel | None = None, jobs: int = 1, seconds: float = 14.0
             ) -> tuple[SearchResult, Data]:
    """Return what a search among the asked effects finds in a record."""
    data = data or Data.of([simulated(effects(*hidden), seconds)], SLOWEST, REFERENCE.sample_time)
    others = [name for name in catalogue() if name not in asked]
    with np.errstate(all='ignore'):
        return search(data, base or BaseModel(REFERENCE), jobs, lambda *told: None, others), data


def of_elements(hidden: tuple[tuple[str, dict[str, float]], ...]) -> tuple[SearchResult, Data]:
    """Return whether more inertia of a hub is found in a finite-element arm."""
    truth = make_record(TruthCase(5, hidden, duration_s=18.0, tolerances=False))
    record = Record('truth', truth.time, truth.command, np.hstack([truth.joint, truth.strain]),
                    0.1)
    return searched((), Data.of([record], SLOWEST, REFERENCE.sample_time), ('hub_inertia',))


@pytest.fixture(scope='module')
def clean() -> tuple[SearchResult, Data]:
    """Return what is found where nothing is hidden."""
    return searched((), seconds=16.0)


def test_two_causes_are_found_together_in_few_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    passes, whitened = [0], Predictor.whitened_residual

    def counted(*arguments: object, **named: object) -> object:
        passes[0] += 1
        return whitened(*arguments, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(Predictor, 'whitened_residual', counted)
    found, _ = searched(HIDDEN, seconds=28.0)
    best = found.posterior.best
    pieces = CauseSet(best.hypotheses, 28.0).split(best.values)
    sizes = {h.label: float(v[0]) for h, v in zip(best.hypotheses, pieces)}
    assert sizes == {'viscous_friction:joint_2': pytest.approx(3.0, rel=0.05),
                     'strain_gain:strain_2a': pytest.approx(0.8, rel=0.05)}
    assert all(found.posterior.effect_probability(name) > SURE for name in (
        'viscous_friction', 'strain_gain'))
    posterior = found.posterior
    assert posterior.probability.sum() + sum(posterior.unfitted.values()) == pytest.approx(1.0)
    assert SetKey.of(found.best.fit) == SetKey.of(best)
    assert passes[0] < MOST_PASSES


def test_a_dropped_payload_is_found_and_nothing_beside_it() -> None:
    # Far beyond the first probed size; modal_truncation at its null does nothing.
    hidden = effects('payload_change:arm:change_kg=-0.095,time_s=12.3,duration_s=0')
    data = Data.of([simulated(hidden, 22.0)], SLOWEST, REFERENCE.sample_time)
    asked = ('payload_change', 'payload_mass', 'strain_filter', 'modal_truncation')
    found, _ = searched((), data, asked)
    cause, = found.posterior.best.hypotheses
    assert cause.label == 'payload_change:arm' and REFERENCE.payload_mass == 0.1
    change, start, duration = found.posterior.best.values
    assert change == pytest.approx(-0.095, abs=0.003)
    assert start + 0.5 * duration == pytest.approx(12.3, abs=0.05) and duration < 0.5


def test_a_spring_is_found_that_rests_where_the_joint_works() -> None:
    # Its torque then swings around zero, and one that rests at zero looks like no spring.
    robot, rest = load_robot('quanser_2dsfl'), -0.255
    truth = make_record(TruthCase(
        1004, (('joint_spring', {'joint': 2, 'stiffness': 0.3, 'rest': rest}),), robot.name,
        duration_s=18.0, tolerances=False, payload_true=0.157, payload_told=0.157))
    assert np.mean(truth.joint[:, 1]) == pytest.approx(rest, abs=0.01)
    record = Record('truth', truth.time, truth.command, np.hstack([truth.joint, truth.strain]),
                    0.157)
    base = nominal_base(robot, 'assumed_modes', 3)
    data = Data.of([record], slowest_frequency(base, 0.157), robot.sample_time)
    found, _ = searched((), data, ('joint_spring', 'torque_ripple'), base)
    cause, = found.posterior.best.hypotheses
    assert cause.label == 'joint_spring:joint_2'
    assert found.posterior.best.values[1] == pytest.approx(rest, abs=0.03)


@pytest.mark.skipif(not HAVE_MUJOCO, reason=NO_MUJOCO)
def test_a_base_that_shifts_is_not_taken_for_one_that_turns() -> None:
    # Along a trajectory without the base's motion, what turns looks nearer than what shifts.
    truth = make_record(TruthCase(
        2, (('base_sliding', {'stiffness': 612.0, 'mass': 3.0, 'damping_ratio': 0.05}),),
        duration_s=18.0, tolerances=False, simulator=MUJOCO))
    record = Record('truth', truth.time, truth.command, np.hstack([truth.joint, truth.strain]),
                    0.1)
    found, _ = searched((), Data.of([record], SLOWEST, REFERENCE.sample_time),
                        ('base_sliding', 'base_compliance'),
                        nominal_base(REFERENCE, 'assumed_modes', 2))
    cause, = found.posterior.best.hypotheses
    assert cause.label == 'base_sliding:arm'
    assert found.posterior.best.values[0] == pytest.approx(1.0 / 612.0, rel=0.15)


def test_a_brake_far_stronger_than_the_drive_s_damping_is_found() -> None:
    found, _ = searched(('viscous_friction:joint_1:damping_n_m_s=10',))
    cause, = found.posterior.best.hypotheses
    assert cause.label == 'viscous_friction:joint_1'
    best = found.posterior.best
    assert best.values == pytest.approx([10.0], abs=2.0 * np.sqrt(best.covariance[0, 0]), rel=0)
    assert best.values == pytest.approx([10.0], rel=0.1)


def test_a_part_that_no_effect_asked_speaks_of_is_told_where_it_is() -> None:
    # Half as fast a velocity loop is a damping ln 2 below its file, at the same steady gain.
    found, _ = searched(('drive_bandwidth:joint_2:time_constant_factor=2',), None,
                        ('strain_gain',), seconds=16.0)
    best = found.best
    assert best.fit.hypotheses == () and best.fit.discrepancy.far_part == 'drive_damping_2'
    parts = [part.name for part in best.likelihood.parts]
    assert best.fit.deviations[parts.index('drive_damping_2')] == pytest.approx(
        -np.log(2.0), abs=0.1)
    assert found.posterior.unknown_probability > 0.9


@pytest.mark.parametrize('link, factor', [('link_1', 1.3), ('link_2', 0.75)])
def test_what_a_part_far_off_does_as_well_is_named_with_its_whole_size(link: str, factor: float
                                                                       ) -> None:
    found, _ = searched((f'link_stiffness:{link}:factor={factor}',))
    cause, = found.posterior.best.hypotheses
    assert cause.label == f'link_stiffness:{link}'
    # All but a seventieth is the cause's, as variances are; a nat leaves the part 1.4 tolerances.
    assert found.posterior.best.values == pytest.approx([factor], rel=1.4 * 0.03)
    assert found.posterior.effect_probability('link_stiffness') > SURE


def test_a_cause_is_found_that_parts_far_off_stand_for() -> None:
    # One clamped-free shape a link of an arm that has three: with parts alone 7 tolerances off.
    asked = ('modal_truncation', 'strain_gain', 'link_stiffness', 'clamp_compliance')
    found, _ = searched((), None, asked, BaseModel(REFERENCE, 'paper', 1))
    cause, = found.posterior.best.hypotheses
    assert cause.label == 'modal_truncation:arm' and cause.fixed_values[0] >= 3.0
    tolerances = found.best.likelihood.tolerances
    assert np.max(np.abs(found.nothing.fit.deviations / tolerances)) > 5.0
    assert np.max(np.abs(found.best.fit.deviations / tolerances)) < 2.0


def test_a_payload_told_wrong_is_found_though_parts_undo_most_of_it() -> None:
    # Around the file's parts 40 g are behind no cause, whose parts are where they fit best.
    found, _ = searched(('payload_mass:arm:deviation_kg=0.04',), None,
                        ('payload_mass', 'strain_gain', 'link_stiffness', 'strain_filter'))
    cause, = found.posterior.best.hypotheses
    assert cause.label == 'payload_mass:arm'
    best = found.posterior.best
    assert abs(best.values[0] - 0.04) < 2.0 * np.sqrt(best.covariance[0, 0]) < 0.01
    assert np.max(np.abs(found.nothing.fit.deviations / found.best.likelihood.tolerances)) > 3.0


def test_nothing_is_found_where_nothing_is_hidden(clean: tuple[SearchResult, Data]) -> None:
    found, _ = clean
    assert found.posterior.nothing_probability > 0.9
    assert found.posterior.unknown_probability < 0.01
    assert found.best.fit.error_scale == pytest.approx(1.0)


def test_a_limit_is_what_parts_cannot_undo(clean: tuple[SearchResult, Data]) -> None:
    found, data = clean
    with np.errstate(all='ignore'):
        limits = detection_limits(found.proposals, REFERENCE, data.duration, found.information)
    # What one Gaussian that is wider promises over the tolerance's own, on average, is the price.
    effect, tolerance = catalogue()['link_stiffness'], REFERENCE.tolerances.stiffness
    wide = np.hypot(tolerance, effect.parameters[0].typical)
    # Of all identifiers none is at work in every second record; links are two.
    price = np.log(2.0 / (2.0**(1.0 / len(catalogue())) - 1.0))
    for link in ('link_1', 'link_2'):
        x = limits[f'link_stiffness:{link}'].easiest + tolerance * NORMAL
        gained = np.mean(norm.logpdf(x, scale=wide) - norm.logpdf(x, scale=tolerance))
        assert price - 0.1 < gained < price + 1.0
        # Parts follow a stiffer link farther than a softer one.
        assert 1.0 <= limits[f'link_stiffness:{link}'].value / (x - tolerance * NORMAL)[0] < 1.2
    for gauge in REFERENCE.gauge_names:
        assert limits[f'strain_gain:{gauge}'].easiest > REFERENCE.tolerances.strain_gain


def test_a_limit_of_commands_shows_only_where_commands_reach_it(
        clean: tuple[SearchResult, Data]) -> None:
    _, data = clean
    found, _ = searched((), data, ('actuator_saturation',))
    with np.errstate(all='ignore'):
        limits = detection_limits(found.proposals, REFERENCE, data.duration, found.information)
    for joint, reached in enumerate(np.abs(data.windows[0].record.command).max(axis=0)):
        inverse = limits[f'actuator_saturation:joint_{joint + 1}'].value
        assert 0.3 * reached < 1.0 / inverse < (1.0 + CLOSE) * reached


def test_from_its_limit_on_a_cause_is_named_though_parts_follow_it() -> None:
    # A softer upper link is nearly an elbow of more inertia: of 0.0209 nothing was named where
    # 0.0052 was said to show.
    found, data = of_elements(())
    limit = detection_limits(found.proposals, REFERENCE, data.duration, found.information)[
        'hub_inertia:elbow'].value
    named = [of_elements((('hub_inertia', {'inertia': factor * limit}),))[0]
             .posterior.effect_probability('hub_inertia') for factor in (0.6, 2.0)]
    assert named[0] < 0.5 < 0.8 < named[1]


def test_a_limit_is_that_of_the_side_of_null_that_is_harder_to_see(
        clean: tuple[SearchResult, Data]) -> None:
    found, data = clean

    def limits(less: float, more: float) -> Mapping[str, DetectionLimit]:
        return detection_limits(found.proposals, REFERENCE, data.duration,
                                lambda _, deviation: less if deviation < 0.0 else more)

    clear, faint = limits(2500.0, 2500.0), limits(400.0, 400.0)
    for one_sided in (limits(2500.0, 400.0), limits(400.0, 2500.0)):
        for label in ('viscous_friction:joint_1', 'actuator_gain:joint_2', 'payload_change:arm'):
            limit = one_sided[label]
            assert limit.value == pytest.approx(faint[label].value, rel=CLOSE)
            assert limit.easiest == pytest.approx(clear[label].value, rel=CLOSE)
            assert limit.value > 2.0 * limit.easiest


def test_where_information_hardly_depends_on_the_size_one_probe_gives_the_limit(
        clean: tuple[SearchResult, Data]) -> None:
    _, data = clean
    found, _ = searched((), data, ('strain_crosstalk', 'actuator_saturation'))
    probed: list[str] = []

    def information(hypothesis: Hypothesis, deviation: float) -> float:
        probed.append(hypothesis.label)
        return found.information(hypothesis, deviation)

    crosstalk, saturation = (
        next(p for p in found.proposals if p.hypothesis.label == label)
        for label in ('strain_crosstalk:strain_1a', 'actuator_saturation:joint_1'))
    detection_limits([crosstalk, saturation], REFERENCE, data.duration, information)
    assert probed.count('strain_crosstalk:strain_1a') == 1
    assert probed.count('actuator_saturation:joint_1') > 1
    assert is_steep(saturation) and not is_steep(crosstalk)


def linearised_at_prior(found: SearchResult, data: Data
                        ) -> tuple[CauseSet, GaussNewton, np.ndarray, np.ndarray]:
    """Return the best proposal as a set, its solver, the prior's centre and the residual there."""
    causes = CauseSet([next(p.hypothesis for p in found.proposals)], data.duration)
    solver = GaussNewton(found.best.likelihood, causes, found.nothing.fit.error_scale)
    values = causes.prior.centre
    return causes, solver, values, solver.residual_and_cost(values)[0]


def test_what_diverges_is_no_prediction_though_its_last_sample_is_finite(
        clean: tuple[SearchResult, Data], monkeypatch: pytest.MonkeyPatch) -> None:
    causes, solver, values, residual = linearised_at_prior(*clean)
    assert np.any(solver.linearise(values, residual, 0.0).jacobian)
    step = causes.difference_steps(values)[0]
    monkeypatch.setattr(CauseSet, 'residual', lambda *_: (residual + 1e200 * step)[None])
    with pytest.raises(np.linalg.LinAlgError, match='no finite prediction'):
        solver.linearise(values, residual, 0.0)


def test_a_difference_that_ends_where_nothing_is_stable_is_taken_shorter(
        clean: tuple[SearchResult, Data], monkeypatch: pytest.MonkeyPatch) -> None:
    causes, solver, values, residual = linearised_at_prior(*clean)
    reach = np.abs(causes.difference_steps(values))

    def stable_nearby(_: CauseSet, likelihood: object, moved: np.ndarray) -> np.ndarray:
        change = np.atleast_2d(moved) - values
        line = residual + 3.0 * change.sum(axis=1)[:, None, None]
        return np.where(np.any(np.abs(change) >= reach, axis=1)[:, None, None], np.nan, line)

    monkeypatch.setattr(CauseSet, 'residual', stable_nearby)
    rows = solver.linearise(values, residual, 0.0).jacobian
    assert rows == pytest.approx(3.0, rel=1e-3)


def test_a_difference_at_null_stays_well_within_the_prior() -> None:
    for robot in map(load_robot, ('reference', 'quanser_2dsfl')):
        for hypothesis in all_hypotheses(robot):
            free = hypothesis.low < hypothesis.high
            shares = np.abs(hypothesis.difference_steps(hypothesis.null))[free] \
                / hypothesis.prior(40.0).width[free]
            assert np.all(shares < 0.3), hypothesis.label


def test_workers_give_what_one_process_gives_and_say_what_went_wrong() -> None:
    def root(number: int) -> float:
        if number == 3:
            raise np.linalg.LinAlgError('left out')
        if number > 9:
            raise ValueError('ten')
        return number**0.5

    alone, together = each(root, range(8), 1), each(root, range(8), 3)
    assert together == alone and len(alone) == 7
    with pytest.raises(ValueError, match='ten'):
        each(root, range(12), 2)
    # A worker may have none of its own, and does alone what it is asked for.
    assert each(lambda k: sum(each(root, range(k), 2)), range(4), 2) == pytest.approx(
        [0.0, 0.0, 1.0, 1.0 + 2.0**0.5])


def test_a_search_ends_alike_in_one_process_and_in_several() -> None:
    few = ('viscous_friction', 'strain_gain')
    (alone, _), (together, _) = (searched(HIDDEN, None, few, jobs=jobs) for jobs in (1, 3))
    assert {h.label for h in together.best.fit.hypotheses} == {
        'viscous_friction:joint_2', 'strain_gain:strain_2a'}
    for one, other in zip(alone.posterior.fits, together.posterior.fits, strict=True):
        assert one.hypotheses == other.hypotheses
        assert other.log_evidence == one.log_evidence
        assert np.array_equal(one.values, other.values)
