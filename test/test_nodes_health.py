"""Model health online: silent for a right model, and right about what is wrong."""

from __future__ import annotations

from flex_payload_estimator.nodes.model_health import ModelHealth
from msg_config.errors import InputError
import numpy as np
import pytest

NAMES = ('joint_1', 'joint_2', 'strain_1a')
STD = np.array([2e-4, 2e-4, 5e-7])
T = 0.01


def fed(innovation: np.ndarray, window: int = 400) -> ModelHealth:
    """Return the health after innovations in standard deviations, (N, 3)."""
    health = ModelHealth(NAMES, T, window)
    for row in innovation:
        health.add(row * STD, STD)
    return health


def white(samples: int = 4000, seed: int = 1) -> np.ndarray:
    """Return what a right model leaves."""
    return np.random.default_rng(seed).standard_normal((samples, 3))


def test_a_right_model_is_healthy_for_six_minutes_of_data() -> None:
    health = ModelHealth(NAMES, T)
    for row in white(36_000):
        health.add(row * STD, STD)
        if health._judged == health._count:
            assert not any(channel.suspect for channel in health.channels())
    report = health.report()
    assert not report.diagnose
    assert [c.nis for c in report.channels] == pytest.approx([1.0] * len(NAMES), abs=0.2)
    assert report.text == 'the model explains the measurements'


def test_no_verdict_before_the_window_is_full() -> None:
    report = fed(100.0 * white(399)).report()
    assert report.channels == ()
    assert not report.diagnose
    assert report.text == 'collecting 400 samples'


def wrong(kind: str) -> np.ndarray:
    """Return innovations whose joint_2 is wrong in one way."""
    innovation = white()
    time = T * np.arange(len(innovation))
    innovation[:, 1] += {
        'offset': 3.0 + 0.0 * time,
        'oscillation at 7': 2.5 * np.sin(2.0 * np.pi * 7.0 * time),
        'slow error': np.convolve(
            white(seed=2)[:, 0], np.exp(-np.arange(200) / 50.0), 'same'),
        'spikes': 60.0 * (np.arange(len(time)) % 97 == 0),
        'more noise': 3.0 * white(seed=3)[:, 0]}[kind]
    return innovation


@pytest.mark.parametrize('kind', [
    'offset', 'oscillation at 7', 'slow error', 'spikes', 'more noise'])
def test_the_wrong_channel_and_its_shape_are_named(kind: str) -> None:
    report = fed(wrong(kind)).report()
    assert [channel.suspect for channel in report.channels] == [False, True, False]
    assert report.channels[1].shape.startswith(kind)
    assert report.diagnose
    assert report.text.startswith(f'joint_2 does not fit the model: {kind}')
    assert 'flex_diagnose' in report.text


def test_a_short_disturbance_is_told_but_advises_nothing() -> None:
    innovation = white()
    innovation[3700:3750, 2] += 20.0
    report = fed(innovation).report()
    assert report.channels[2].suspect
    assert not report.diagnose


def test_a_wide_r_2_is_no_fault_of_the_model() -> None:
    slow = np.convolve(white()[:, 0], np.ones(20) / 20.0, 'same')[:, None] * np.ones(3)
    report = fed(0.1 * slow).report()
    assert not any(channel.suspect for channel in report.channels)


def test_what_is_not_finite_is_left_out() -> None:
    health = fed(white())
    before = health.report()
    health.add(np.array([np.nan, 0.0, 0.0]), STD)
    health.add(np.zeros(3), np.array([0.0, 1.0, 1.0]))
    assert health.report() == before


def test_a_window_too_short_for_its_lags_is_refused() -> None:
    with pytest.raises(InputError, match='expected a window of more than 40 samples, got 40'):
        ModelHealth(NAMES, T, 40)
