"""What is wrong before a cause is named, against closed forms and made-up dependences."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.diagnosis.prediction.free_run import free_run
from flex_plant_sim.diagnosis.prediction.spectrum import power_density
from flex_plant_sim.diagnosis.verdict.symptoms import (
    bands,
    describe,
    explained_share,
    natural_frequencies,
    whiteness,
)
import numpy as np
import pytest
from scipy.signal import welch
from simulated_records import effects, predictor, REFERENCE, simulated


@pytest.mark.parametrize('level', [False, True])
@pytest.mark.parametrize('length', [64, 75])
def test_power_density_is_welch_s(length: int, level: bool) -> None:
    values = 2.0 + np.random.default_rng(3).standard_normal((300, 2))
    frequency, power = power_density(values, 0.01, length, level)
    expected = welch(values, 100.0, nperseg=length, axis=0,
                     detrend='constant' if level else False)
    np.testing.assert_allclose(frequency, expected[0], rtol=1e-12)
    np.testing.assert_allclose(power, expected[1], rtol=1e-9)


def test_white_noise_passes_and_is_not_predictable() -> None:
    rng = np.random.default_rng(0)
    p_values = [whiteness([rng.standard_normal(2000)]).p_value for _ in range(60)]
    assert 0.0 <= np.mean(np.array(p_values) < 0.05) <= 0.15
    assert 0.35 < np.mean(p_values) < 0.65
    assert whiteness([rng.standard_normal(5000)]).predictable < 0.01


def test_predictable_share_of_an_autoregression() -> None:
    """x_k = 0.8 x_(k-1) + e_k: the past tells 0.8^2 of the variance; stretches are pooled."""
    rng, parts = np.random.default_rng(1), []
    for _ in range(4):
        noise, x = rng.standard_normal(5000), np.zeros(5000)
        for k in range(1, 5000):
            x[k] = 0.8 * x[k - 1] + noise[k]
        parts.append(x)
    found = whiteness(parts)
    assert found.predictable == pytest.approx(0.64, abs=0.02)
    assert found.p_value < 1e-6


def test_small_colour_is_small_though_significant() -> None:
    """With 50 000 samples a colour of 2 % of the variance fails every test."""
    rng = np.random.default_rng(2)
    noise = rng.standard_normal(50001)
    found = whiteness([noise[1:] + 0.15 * noise[:-1]])
    assert found.p_value < 1e-6
    assert found.predictable == pytest.approx(0.15**2, abs=0.01)


def test_a_residual_that_is_zero_is_white() -> None:
    assert whiteness([np.zeros(100)]).predictable == 0.0


def test_shares_of_known_shapes() -> None:
    """Half the power is the shape, the rest noise; another shape explains nothing."""
    rng, count = np.random.default_rng(3), 4000
    speed = np.sin(np.arange(count) / 70.0)
    residual = np.stack([np.sign(speed) + rng.standard_normal(count),
                         rng.standard_normal(count)], axis=1)
    fold = np.arange(count) // 400 % 5
    share = explained_share(residual, np.sign(speed)[:, None], fold)
    assert share[0] == pytest.approx(0.5, abs=0.03)
    assert share[1] < 0.01
    other = explained_share(residual, rng.standard_normal((count, 12)), fold)
    assert np.all(other < 0.01)


def test_a_tone_lies_in_its_band() -> None:
    time = np.arange(4000) * 0.01
    rng = np.random.default_rng(4)
    tone = np.stack([np.sin(2 * np.pi * 3.0 * time), rng.standard_normal(4000)], axis=1)
    found = bands([tone], np.array([0.0, 1.0, 5.0, 50.5]), 0.01)
    assert [round(share, 2) for _, _, share, _ in found[0]] == [0.0, 1.0, 0.0]
    for row in found:
        assert sum(share for _, _, share, _ in row) == pytest.approx(1.0)
    white = np.array([(share, even) for _, _, share, even in found[1]])
    np.testing.assert_allclose(white[:, 0], white[:, 1], atol=0.03)


def test_frequencies_lie_in_the_range_of_the_arm() -> None:
    found = natural_frequencies(predictor(simulated()))
    lower = REFERENCE.links[1].beam(1).frequencies[0] / (2 * np.pi)
    assert np.all(np.diff(found) >= 0.0)
    # The payload makes the slowest mode of the arm slower than the bare lower link's.
    assert 0.1 * lower < found[0] < lower


def test_dry_friction_shows_as_velocity_sign_in_its_joint() -> None:
    rows = {row.channel: row for row in describe(
        [predictor(simulated(effects('coulomb_friction:joint_2:level_n_m=0.4')))])}
    joint = rows['joint_2']
    assert max(joint.drifted, key=lambda shape: joint.drifted[shape]) == 'velocity sign'
    assert joint.drifted['velocity sign'] > 0.8
    assert joint.free_run[1.0] > 20.0 * joint.noise
    assert joint.whiteness.predictable > 0.5


@pytest.mark.parametrize('hidden, channel, shape', [
    ('strain_bias:strain_2a:bias=2e-5', 'strain_2a', 'constant'),
    ('strain_drift:strain_1b:drift_per_s=2e-6', 'strain_1b', 'time')])
def test_sensor_faults_show_their_shape(hidden: str, channel: str, shape: str) -> None:
    rows = {row.channel: row for row in describe([predictor(simulated(effects(hidden)))])}
    assert rows[channel].one_step[shape] > 0.4


def test_a_true_model_that_expects_no_disturbance_leaves_noise() -> None:
    source = predictor(simulated(noise=0.0))
    run = free_run(source, np.array([0]), len(source.record.time))[:, 0]
    spread = np.array([1e-4] * 2 + [5e-7] * 4)
    noisy = run + spread * np.random.default_rng(5).standard_normal(run.shape)
    record = replace(source.record, output=noisy)
    for row in describe([predictor(record, noise_shares=(5e-4, 1e-4))]):
        assert row.whiteness.predictable < 0.1
        assert row.free_run[0.01] < 1.5 * row.noise
        assert all(share < 0.1 for share in row.one_step.values())


@pytest.mark.parametrize('value', [np.inf, np.nan, 1e200])
def test_a_prediction_that_diverges_is_described_and_said_to_diverge(value: float) -> None:
    source = predictor(simulated())
    source.states[1500:] = value
    for row in describe([source]):
        assert 0.0 <= row.whiteness.predictable < 1.0
        assert all(0.0 <= share <= 1.0 for share in (
            *row.drifted.values(), *row.one_step.values()))
        assert sum(share for _, _, share, _ in row.bands) == pytest.approx(1.0)
        assert not np.isfinite(row.results()['free_run']['0.01'])


def test_results_are_plain() -> None:
    row = describe([predictor(simulated())])[0].results()
    assert set(row['free_run']) == {'0.01', '0.2', '1', '5'}
    assert row['whiteness']['lags'] == 20
