"""Latent forces: the smoother against Gaussian conditioning, laws against hidden torques."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.prediction import smoother
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.friction_part import friction_part, FrictionPart
from flex_plant_sim.diagnosis.prediction.latent_forces import latent_forces, LatentForces
from flex_plant_sim.diagnosis.prediction.latent_series import gauge_series, torque_series
from flex_plant_sim.diagnosis.prediction.latent_view import latent_view
from flex_plant_sim.diagnosis.prediction.law import Law, law_of
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.diagnosis.prediction.smoother import LatentSystem, smooth
from flex_plant_sim.diagnosis.record.sensor_noise import measurement_noise
from flex_plant_sim.diagnosis.record.windows import Record, Windows
from flex_plant_sim.diagnosis.verdict.improvement import measure_gain
from flex_plant_sim.diagnosis.verdict.unknown import sentences_of
from flex_plant_sim.diagnosis.verdict.verdict import slowest_frequency
from flex_plant_sim.effects import catalogue
from flex_plant_sim.effects.base import Effect, Motion
import numpy as np
import pytest
from simulated_records import effects, predictor, REFERENCE, simulated, SLOWEST
from truth.records import make_record, TruthCase

SECONDS = 24.0


def small_system(count: int) -> LatentSystem:
    """Return an arbitrary system with two states and three channels."""
    rng = np.random.default_rng(3)
    table = np.stack([np.hstack([[[0.9, 0.1], [-0.2, 0.8]], rng.normal(size=(2, 2))])] * 2)
    share = rng.uniform(size=(count, 1))
    return LatentSystem(
        np.hstack([share, 1.0 - share]), table + 0.05 * rng.normal(size=table.shape),
        rng.normal(size=(count, 2)), rng.normal(size=(3, 2)), rng.normal(size=(count, 3)),
        np.array([0.1, 0.2, 0.3]), 0.02 * np.eye(2), 0.7,
        rng.uniform(0.05, 0.3, (count, 3)), np.array([0.3, -0.2]),
        np.array([0.5, 0.4, 0.3, 0.2, 0.1]))


def conditioned(system: LatentSystem) -> tuple[Array, Array]:
    """Return mean and deviation of z (N, 5) by one big matrix."""
    count, d = len(system.measured), 5
    mean, covariance = np.zeros(count * d), np.zeros((count * d, count * d))
    mean[:2], covariance[:d, :d] = system.initial_mean, np.diag(system.initial_deviation**2)
    for k in range(count - 1):
        a, here, after = np.zeros((d, d)), slice(k * d, k * d + d), slice(k * d + d, k * d + 2 * d)
        a[:2, :4] = np.tensordot(system.weights[k], system.table, axes=1)
        a[2, 2] = a[3, 3] = 1.0
        a[4, 4] = system.decay
        q = np.zeros((d, d))
        q[:2, :2], q[2:, 2:] = system.process_covariance, np.diag(system.walk_variance[k])
        mean[after] = a @ mean[here] + np.append(system.known_step[k], np.zeros(3))
        covariance[after, :k * d + d] = a @ covariance[here, :k * d + d]
        covariance[:k * d + d, after] = covariance[after, :k * d + d].T
        covariance[after, after] = a @ covariance[here, here] @ a.T + q
    c = np.kron(np.eye(count), np.hstack([system.output, np.diag([0.0, 0.0, 1.0])]))
    s = c @ covariance @ c.T + np.kron(np.eye(count), np.diag(system.noise))
    error = system.measured.ravel() - c @ mean
    gain = covariance @ c.T @ np.linalg.inv(s)
    variance = np.diagonal(covariance - gain @ c @ covariance)
    return (mean + gain @ error).reshape(count, d), np.sqrt(variance).reshape(count, d)


@pytest.mark.parametrize('block_bytes', [1e9, 8 * 5 * 8 * 7])
def test_smoother_is_gaussian_conditioning(block_bytes: float,
                                           monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(smoother, 'BLOCK_BYTES', block_bytes)
    system = small_system(24)
    mean, deviation = conditioned(system)
    found = smooth(system)
    np.testing.assert_allclose(found.mean, mean, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(found.deviation, deviation[:, 2:], rtol=1e-7)


def true_record(case: TruthCase, unseen: Array | None = None) -> Record:
    """Return a finite-element record; `unseen` (N, 2) is added to the command behind the log."""
    truth = make_record(case)
    if unseen is not None:
        command = truth.command
        truth = make_record(case, command + unseen)
        truth = type(truth)(truth.time, command, truth.joint, truth.strain, truth.columns)
    return Record('truth', truth.time, truth.command, np.hstack([truth.joint, truth.strain]),
                  case.payload_told)


def latent(record: Record) -> LatentForces:
    """Return the latent forces of a record under the nominal arm with its Coriolis forces."""
    windows = Windows.cut(record, SLOWEST, REFERENCE.sample_time)[0]
    base = BaseModel(REFERENCE, effects=(catalogue()['coriolis_centripetal']('arm', (1.0,)),))
    return latent_forces(Predictor(base, windows, measurement_noise(record.output)))


def laws(found: LatentForces) -> dict[str, Law]:
    """Return the laws of the joints by site."""
    return {series.site: law_of(series) for series in torque_series([found], REFERENCE)}


@pytest.fixture(scope='module')
def rubbing() -> Record:
    """Return the record of a finite-element arm whose elbow sticks and slips."""
    size = {'joint': 2, 'sliding': 0.25, 'extra': 0.35, 'speed': 0.15}
    return true_record(TruthCase(11, (('stribeck_friction', size),), duration_s=SECONDS,
                                 tolerances=False))


def test_law_carried_into_the_model_gains_where_it_was_not_fitted(rubbing: Record) -> None:
    nominal = predictor(rubbing, effects('coriolis_centripetal:arm:share=1'))
    view = latent_view([nominal])
    assert sentences_of(view)[0].startswith(
        'An unnamed torque of joint 2 (0.37 N·m rms) is a law over its speed, which explains')
    extended = predictor(rubbing, (*nominal.base.effects, *view.law_effects))
    left, = (f for f in latent_view([extended]).torques if f.series.site == 'joint_2')
    assert not left.law.stated and left.series.rms < 0.1 * view.torques[1].series.rms
    gains = {(g.channel, g.horizon): g.ratio for g in measure_gain([nominal], [extended])}
    assert gains['joint_2', 1.0] < 0.1 and gains['strain_2a', 1.0] < 0.7


def test_friction_of_a_finite_element_arm_shows_its_law(rubbing: Record) -> None:
    found = latent(rubbing)
    law = laws(found)['joint_2']
    assert law.stated and law.variable == 'speed' and law.share > 0.97
    speed = found.speed[:, 1]
    true = -np.sign(speed) * (0.25 + 0.35 * np.exp(-(speed / 0.15)**2))
    moving = np.abs(speed) > 0.1
    moving[:200] = False
    error = (found.torque[:, 1] - true)[moving]
    assert np.sqrt(np.mean(error**2)) < 0.03
    assert np.mean(np.abs(error) < 1.96 * found.torque_deviation[moving, 1]) > 0.9
    assert law.at(np.array([0.6]))[0] == pytest.approx(-0.25, abs=0.02)
    assert not laws(found)['joint_1'].stated
    assert not any(law_of(series).stated for series in gauge_series([found], REFERENCE))


def test_a_gap_that_the_model_knows_leaves_no_torque() -> None:
    """The push of its teeth is no unseen torque."""
    gap = {'joint': 2, 'gap': 0.03}
    record = true_record(TruthCase(12, (('backlash', gap),), duration_s=SECONDS,
                                   tolerances=False))
    told = (*effects('coriolis_centripetal:arm:share=1'),
            catalogue()['backlash']('joint_2', (0.03, 1.0, 0.05, 0.0)))
    unknown, known = (latent_view([predictor(record, assumed)]) for assumed in (told[:1], told))
    before, after = (view.torques[1].series.rms for view in (unknown, known))
    assert after < 0.1 * before
    assert not any(f.exceeds_model_error for f in known.findings if f.series.site != 'joint_2')


def test_law_over_speed_is_told_as_friction() -> None:
    hidden = (('coulomb_friction', {'joint': 2, 'torque': 0.4}),
              ('viscous_friction', {'joint': 2, 'coefficient': 0.3}))
    record = true_record(TruthCase(12, hidden, duration_s=SECONDS, tolerances=False))
    series = torque_series([latent(record)], REFERENCE)[1]
    part = friction_part(series)
    assert part.level == pytest.approx(0.4, abs=0.02)
    assert part.damping == pytest.approx(0.3, abs=0.04)
    assert part.share > 0.97


def test_friction_in_words_says_what_is_more_and_what_is_less() -> None:
    assert str(FrictionPart(1.23, -3.41, 0.9)) == (
        '1.2 N·m more dry friction and 3.4 N·m·s/rad less damping')


def test_torque_that_fades_is_one_over_time() -> None:
    time = np.arange(round(SECONDS / REFERENCE.sample_time)) * REFERENCE.sample_time
    torque = np.stack([1.2 * np.exp(-time / 12.0), 0.0 * time], axis=1)
    unseen = torque / [drive.torque_gain for drive in REFERENCE.drives]
    found = latent(true_record(TruthCase(12, duration_s=SECONDS, tolerances=False), unseen))
    law = laws(found)['joint_1']
    assert law.stated and law.variable == 'time' and law.share > 0.95
    at = np.array([3.0, 10.0, 20.0])
    np.testing.assert_allclose(law.at(at), 1.2 * np.exp(-at / 12.0), rtol=0.0, atol=0.05)


@dataclass(frozen=True)
class Unnamed(Effect):
    """A torque on joint 2 that no effect of the package has."""

    law: Callable[[Motion], Array] = lambda motion: np.zeros(1)

    identifier = 'unnamed'
    parameters = ()
    sites = 'joint'

    def force(self, motion: Motion) -> Array:
        return np.asarray(self.law(motion))[..., None] * motion.form.force[:, 1]


def bending(motion: Motion) -> Array:
    """Return the strain at the lower link's first gauge, in thousandths."""
    return np.asarray(1e3 * motion.position @ motion.form.strain[2])


@pytest.mark.parametrize(('variable', 'law'), [
    ('angle', lambda motion: 0.3 * np.sin(7.0 * motion.position[..., 1])),
    ('load', lambda motion: 0.4 * np.tanh(4.0 * bending(motion))),
    ('command', lambda motion: 0.3 * np.exp(-(motion.command[..., 1] / 0.3)**2)),
    ('speed', lambda motion: -1.0 * motion.velocity[..., 1]**3)])
def test_variable_is_named(variable: str, law: Callable[[Motion], Array]) -> None:
    record = simulated((Unnamed('joint_2', (), law),), duration=SECONDS, seed=21)
    # Gauges err for a share of its period.
    slowest = slowest_frequency(BaseModel(REFERENCE), record.payload)
    found = laws(latent_forces(predictor(record, locked=False, slowest=slowest)))['joint_2']
    assert found.variable == variable
    assert found.stated and found.share > 0.8


def test_gauge_that_reads_too_much_shows_in_its_own_strain() -> None:
    case = TruthCase(14, (('strain_gain', {'gauge': 3, 'factor': 1.2}),), duration_s=SECONDS,
                     tolerances=False)
    found = {s.site: law_of(s) for s in gauge_series([latent(true_record(case))], REFERENCE)}
    law = found['strain_2a']
    assert law.stated and law.variable == 'strain'
    slope = (law.values[-1] - law.values[0]) / (law.knots[-1] - law.knots[0])
    assert slope == pytest.approx(0.2, abs=0.02)
