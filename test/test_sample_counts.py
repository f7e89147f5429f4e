"""What the diagnostics say of a node's samples."""

from __future__ import annotations

from flex_payload_estimator.nodes.sample_counts import SampleCounts
import numpy as np
import pytest


def counts_of(intervals: np.ndarray) -> SampleCounts:
    """Return the counts after intervals, s, at a sampling time of 10 ms."""
    counts = SampleCounts(0.01)
    for interval in intervals:
        counts.add_interval(float(interval), 1.0)
    return counts


@pytest.mark.parametrize(('mean', 'text'), [
    (0.009, 'samples come every 0.009 s, expected 0.01 s (sample_time)'),
    (0.011, 'samples come every 0.011 s, expected 0.01 s (sample_time)'),
    (0.0101, 'ok')])
def test_another_rate_is_said(mean: float, text: str) -> None:
    assert counts_of(np.full(300, mean)).status(1.0, '')[1] == text


@pytest.mark.parametrize('intervals', [(2,), (3,), (4,), (20,), (2, 1, 2)])
def test_samples_that_come_too_seldom_are_told_from_lost_ones(intervals: tuple[int, ...]) -> None:
    counts = counts_of(0.01 * np.tile(intervals, 60))
    assert counts.slow
    for _ in range(20):
        assert counts.slow
        counts.add_interval(0.01, 1.0)
    assert not counts.slow
    counts.add_interval(0.03, 1.0)
    assert not counts.slow


@pytest.mark.parametrize('lost', [0.1, 0.3])
def test_samples_that_are_lost_at_random_do_not_come_too_seldom(lost: float) -> None:
    chance = np.random.default_rng(4)
    counts = SampleCounts(0.01)
    for interval in 0.01 * chance.geometric(1.0 - lost, 100_000):
        counts.add_interval(float(interval), 1.0)
        assert not counts.slow


def test_jitter_and_lost_samples_are_no_other_rate() -> None:
    stamps = 0.01 * np.arange(1000) + 0.004 * np.random.default_rng(3).uniform(-0.5, 0.5, 1000)
    kept = np.delete(stamps, [100, 101, 200, 555])
    level, text = counts_of(np.diff(kept)).status(1.0, '')
    assert (level, text) == ('warn', '4 samples lost or not at the sampling time lately')


def test_refused_samples_are_said_with_their_reason() -> None:
    counts = SampleCounts(0.01)
    counts.add('refused', 1.0)
    assert counts.status(2.0, 'joint_1: nan') == ('warn', '1 samples refused lately: joint_1: nan')
    assert counts.status(30.0, '') == ('ok', 'ok')
    assert counts.values() == {'lost or uneven': 0, 'refused': 1, 'restarts': 0}


@pytest.mark.parametrize(('packet', 'apart'), [(2, 3e-4), (4, 3e-4), (5, 1e-3), (10, 3e-4)])
def test_stamps_that_come_in_bursts_are_no_lost_samples(packet: int, apart: float) -> None:
    burst = np.full(packet, apart)
    burst[0] = 0.01 * packet - apart * (packet - 1)
    counts = counts_of(np.tile(burst, 60))
    assert not counts.slow
    assert counts.status(1.0, '') == ('error', counts.bursts)
    assert counts.bursts.startswith(
        f'stamps come in bursts, {apart:.2g} to {burst[0]:.2g} s apart, expected 0.01 s')
    for _ in range(20):
        counts.add_interval(0.01, 1.0)
    assert not counts.bursts
