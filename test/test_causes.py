"""The search among sets of causes, on records of the package's own arm."""

from __future__ import annotations

from flex_plant_sim.diagnosis.causes.fit import Causes, Descent, fitted
from flex_plant_sim.diagnosis.causes.hypothesis import hypotheses
from flex_plant_sim.diagnosis.causes.pool import each
from flex_plant_sim.diagnosis.causes.posterior import Key
from flex_plant_sim.diagnosis.causes.search import Search, search
from flex_plant_sim.diagnosis.causes.sets import Fitter, Settled, Trial
from flex_plant_sim.diagnosis.prediction.predictor import Base, Predictor
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.verdict.detection import detection_limits
from flex_plant_sim.effects import catalogue
import numpy as np
import pytest
from simulated_records import effects, REFERENCE, simulated, SLOWEST

# Friction and what imitates it while the gauge is wrong, too; what parts may undo; an event.
ASKED = ('viscous_friction', 'actuator_gain', 'strain_gain', 'link_stiffness', 'payload_change')
HIDDEN = ('viscous_friction:joint_2:damping_n_m_s=3', 'strain_gain:strain_2a:factor=0.8')
# Of the whole catalogue about 350, see benchmarks/diagnosis_time.py; of these five effects:
MOST_PASSES = 400


def searched(hidden: tuple[str, ...], data: Data | None = None, asked: tuple[str, ...] = ASKED
             ) -> tuple[Search, Data]:
    """Return what a search among the asked effects finds in a record of 28 s."""
    data = data or Data.of([simulated(effects(*hidden), 28.0)], SLOWEST, REFERENCE.sample_time)
    others = [name for name in catalogue() if name not in asked]
    with np.errstate(all='ignore'):
        return search(data, Base(REFERENCE), 1, lambda step, share: None, others), data


@pytest.fixture(scope='module')
def clean() -> tuple[Search, Data]:
    """Return what is found where nothing is hidden."""
    return searched(())


def test_two_causes_are_found_together_in_few_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    passes, whitened = [0], Predictor.whitened

    def counted(*arguments: object, **named: object) -> object:
        passes[0] += 1
        return whitened(*arguments, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(Predictor, 'whitened', counted)
    found, _ = searched(HIDDEN)
    best = found.posterior.best
    pieces = Causes(best.hypotheses, 28.0).split(best.values)
    sizes = {h.label: float(v[0]) for h, v in zip(best.hypotheses, pieces)}
    assert sizes == {'viscous_friction:joint_2': pytest.approx(3.0, rel=0.05),
                     'strain_gain:strain_2a': pytest.approx(0.8, rel=0.05)}
    assert all(found.posterior.of_effect(name) > 0.9 for name in (
        'viscous_friction', 'strain_gain'))
    posterior = found.posterior
    assert posterior.probability.sum() + sum(posterior.unfitted.values()) == pytest.approx(1.0)
    assert Key.of(found.best.fit) == Key.of(best)
    assert passes[0] < MOST_PASSES


def test_a_dropped_payload_is_found_and_nothing_beside_it() -> None:
    # Far beyond what the first look takes for small; modal_truncation at its null does nothing.
    hidden = effects('payload_change:arm:change_kg=-0.095,time_s=12.3,duration_s=0')
    data = Data.of([simulated(hidden, 28.0)], SLOWEST, REFERENCE.sample_time)
    asked = ('payload_change', 'payload_mass', 'strain_filter', 'modal_truncation')
    found, _ = searched((), data, asked)
    cause, = found.posterior.best.hypotheses
    assert cause.label == 'payload_change:arm' and REFERENCE.payload_mass == 0.1
    change, start, duration = found.posterior.best.values
    assert change == pytest.approx(-0.095, abs=0.003)
    assert start + 0.5 * duration == pytest.approx(12.3, abs=0.05) and duration < 0.5


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
                        ('strain_gain',))
    best = found.best
    assert best.fit.hypotheses == () and best.fit.discrepancy.far == 'drive_damping_2'
    assert best.fit.deviations[best.likelihood.far_part] == pytest.approx(-np.log(2.0), abs=0.1)
    assert found.posterior.of_unknown > 0.9


def test_nothing_is_found_where_nothing_is_hidden(clean: tuple[Search, Data]) -> None:
    found, _ = clean
    assert found.posterior.of_nothing > 0.9
    assert found.posterior.of_unknown < 0.01
    assert found.best.fit.scale == pytest.approx(1.0)


def test_a_limit_is_what_parts_cannot_undo(clean: tuple[Search, Data]) -> None:
    found, data = clean
    with np.errstate(all='ignore'):
        limits = detection_limits(found.promises, REFERENCE, data.duration, found.closer)
    for link in ('link_1', 'link_2'):
        assert limits[f'link_stiffness:{link}'][0] > REFERENCE.tolerances.stiffness
    for gauge in REFERENCE.gauge_names:
        assert limits[f'strain_gain:{gauge}'][0] > REFERENCE.tolerances.strain_gain


def test_a_look_alike_is_fitted_along_its_own_trajectory() -> None:
    clamp, base = effects('clamp_compliance:link_1:compliance_rad_per_n_m=0.005',
                          'base_compliance:arm:compliance_rad_per_n_m=0.0045,inertia_kg_m2=0.05')
    data = Data.of([simulated((clamp,), 28.0)], SLOWEST, REFERENCE.sample_time)
    known = {h.label: h for h in hypotheses(REFERENCE)}
    near, far = (Trial((known[f'{e.identifier}:{e.site}'],), (np.array(e.values),))
                 for e in (clamp, base))
    centre = Settled.at(near, Base(REFERENCE), data)
    plain = fitted(centre.likelihood, Causes(far.hypotheses, data.duration), far.starts,
                   centre.fit.scale).log_evidence
    found = Fitter(centre.likelihood, centre.fit.scale, data.duration)(far)
    settled = Settled.at(Trial.of(found), Base(REFERENCE), data).fit.log_evidence
    # The other half needs the parts' columns around itself.
    assert found.log_evidence - plain > 0.5 * (settled - plain) > 5.0


def test_a_limit_of_commands_shows_only_where_commands_reach_it(
        clean: tuple[Search, Data]) -> None:
    _, data = clean
    found, _ = searched((), data, ('actuator_saturation',))
    with np.errstate(all='ignore'):
        limits = detection_limits(found.promises, REFERENCE, data.duration, found.closer)
    for joint, reached in enumerate(np.abs(data.windows[0].record.command).max(axis=0)):
        inverse = limits[f'actuator_saturation:joint_{joint + 1}'][0]
        assert 0.3 * reached < 1.0 / inverse < reached


def test_what_diverges_is_no_prediction_though_its_last_sample_is_finite(
        clean: tuple[Search, Data], monkeypatch: pytest.MonkeyPatch) -> None:
    found, data = clean
    hypothesis = next(p.hypothesis for p in found.promises)
    causes = Causes([hypothesis], data.duration)
    descent = Descent(found.best.likelihood, causes, found.nothing.scale)
    values = causes.slab.centre
    residual = descent.at(values)[0]
    assert np.any(descent.linearise(values, residual, 0.0).columns)
    step = causes.steps(values)[0]
    monkeypatch.setattr(Causes, 'residual', lambda *_: (residual + 1e200 * step)[None])
    with pytest.raises(np.linalg.LinAlgError, match='no finite prediction'):
        descent.linearise(values, residual, 0.0)


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
