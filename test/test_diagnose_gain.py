"""Gains: errors before and after, and intervals that hold what they say."""

from __future__ import annotations

import json
from pathlib import Path

from flex_plant_sim.diagnosis.verdict.improvement import _gains, gain_results, measure_gain
from flex_plant_sim.tools.command_line import write_json
from msg_config.errors import InputError
import numpy as np
import pytest
from simulated_records import effects, predictor, simulated

CHANNELS = [('joint_1', 'rad'), ('joint_2', 'rad')]
FRICTION = 'coulomb_friction:joint_2:level_n_m=0.4'


def test_the_right_effect_takes_the_error_of_its_joint_away() -> None:
    hidden = effects(FRICTION)
    record = simulated(hidden, 40.0)
    before, after = predictor(record), predictor(record, hidden)
    gains = {(g.channel, g.horizon): g for g in measure_gain([before], [after])}
    found = gains['joint_2', 1.0]
    assert found.ratio < 0.05
    assert found.ratio_low <= found.ratio <= found.ratio_high < 0.1
    assert found.low <= found.after <= found.high
    assert {h for _, h in gains} == {0.01, 0.2, 1.0, 2.0, 5.0}


def test_one_step_errors_are_those_of_the_innovations() -> None:
    record = simulated(effects(FRICTION), 40.0)
    p = predictor(record)
    direct = np.sqrt(np.mean(p.innovations()[0]**2, axis=(0, 1)))
    found = [g.before for g in measure_gain([p], [p]) if g.horizon == 0.01]
    # A quarter of the samples, and the filter runs through instead of warming up per window.
    np.testing.assert_allclose(found, direct, rtol=0.15)


def test_the_same_model_gains_nothing() -> None:
    p = predictor(simulated())
    for gain in measure_gain([p], [p]):
        assert gain.before == gain.after
        assert (gain.ratio_low, gain.ratio, gain.ratio_high) == (1.0, 1.0, 1.0)


def test_the_same_seed_gives_the_same_intervals() -> None:
    p, q = predictor(simulated()), predictor(simulated(), effects(FRICTION))
    first, again, other = (measure_gain([p], [q], seed=seed) for seed in (0, 0, 1))
    assert first == again
    assert [g.after for g in first] == [g.after for g in other]
    assert [g.low for g in first] != [g.low for g in other]


def test_horizons_beyond_the_locked_part_are_left_out() -> None:
    p = predictor(simulated(duration=16.0))
    gains = measure_gain([p], [p])
    assert {g.horizon for g in gains} == {0.01, 0.2, 1.0, 2.0}


def test_records_must_match() -> None:
    p = predictor(simulated())
    with pytest.raises(InputError, match='got 1 and 2'):
        measure_gain([p], [p, p])
    with pytest.raises(InputError, match='got 0 and 0'):
        measure_gain([], [])


def correlated(rng: np.random.Generator, count: int, phi: float) -> np.ndarray:
    """Return an autoregression of unit variance."""
    values = np.empty(count)
    values[0] = rng.standard_normal()
    for k in range(1, count):
        values[k] = phi * values[k - 1] + np.sqrt(1 - phi**2) * rng.standard_normal()
    return values


def test_intervals_of_correlated_errors_hold_the_truth_about_as_often_as_they_say() -> None:
    """Errors of unit variance, correlated over ten starts, blocks of twenty: 95 % intervals."""
    rng, held, rounds = np.random.default_rng(1), 0, 100
    for _ in range(rounds):
        pair = np.stack([correlated(rng, 400, 0.9), correlated(rng, 400, 0.9)])[..., None]
        gain = _gains([('x', 'rad')], 1.0, [pair], [20], rng)[0]
        held += gain.low <= 1.0 <= gain.high
    assert 0.85 <= held / rounds <= 0.99


@pytest.mark.parametrize('count', [400, 407])
def test_an_error_that_never_changes_has_no_spread(count: int) -> None:
    """Blocks of 20 that overhang the record by 13 starts are scaled to its own number."""
    gain, = _gains([('x', 'rad')], 1.0, [np.ones((2, count, 1))], [20], np.random.default_rng(4))
    assert (gain.low, gain.after, gain.high) == pytest.approx((1.0, 1.0, 1.0), rel=1e-12)


def test_blocks_matter_for_correlated_errors() -> None:
    """Without blocks the interval of a slow error would be far too narrow."""
    rng = np.random.default_rng(2)
    pair = np.stack([correlated(rng, 400, 0.95)] * 2)[..., None]
    narrow, wide = (_gains([('x', 'rad')], 1.0, [pair], [length], np.random.default_rng(3))[0]
                    for length in (1, 40))
    assert wide.high - wide.low > 2.0 * (narrow.high - narrow.low)


def test_json_has_one_list_a_figure_and_nothing_infinite(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    fine = rng.standard_normal((2, 50, 2))
    broken = fine.copy()
    broken[0, 3, 1] = np.inf
    write_json(tmp_path / 'gain.json', gain_results(
        _gains(CHANNELS, 0.2, [fine], [5], rng) + _gains(CHANNELS, 5.0, [broken], [5], rng)))
    rows = json.loads((tmp_path / 'gain.json').read_text())
    assert rows['joint_1']['horizon_s'] == [0.2, 5.0]
    assert rows['joint_2']['before'][0] == pytest.approx(np.sqrt(np.mean(fine[0, :, 1]**2)))
    assert rows['joint_2']['before'][1] is None
    assert {len(rows['joint_2'][key]) for key in ('before', 'after', 'low', 'high')} == {2}
