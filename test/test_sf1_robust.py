"""SF1 where nothing can be learnt, and fed with what no arm does."""

from __future__ import annotations

from dataclasses import replace
import math
from typing import Any, cast

from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.estimators.sf1.estimator import SF1Estimator
from flex_payload_estimator.estimators.sf1.settings import (
    PAPER_SETTINGS,
    SF1EstimatorSettings,
    SF1Settings,
)
from flex_plant_sim.arm.robot_file import load_robot
from msg_config.errors import InputError
import numpy as np
import pytest

ROBOT = load_robot('reference')
NAMES = ('sf1_paper', 'sf1')


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('noise', [0.0, 1.0, 1.5])
def test_noise_alone_teaches_nothing(name: str, noise: float) -> None:
    """At rest, with the file's noise and half as much again: never ok, never surer."""
    estimator, random = make_estimator(name, ROBOT, 'paper_reduced', 2), np.random.default_rng(8)
    sensors = noise * np.array([2e-4, 2e-4, *4 * [5e-7]])
    for k in range(3000):
        estimate = estimator.update(0.01 * k, sensors * random.standard_normal(6), np.zeros(2))
        assert estimate.status == 'not_excited'
        assert estimate.variance >= 0.04


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('step', [1e-5, 0.1])
def test_no_sampling_interval_breaks_it(name: str, step: float) -> None:
    """A light arm at 0.1 s: n' = 15 terms do not hold A T; (19) is then no exponential."""
    light = replace(ROBOT.with_link(1, density=270.0), sample_time=step)
    estimator, random = make_estimator(name, light, 'paper_reduced', 2), np.random.default_rng(9)
    for k in range(300):
        estimate = estimator.update(step * k, 0.01 * random.standard_normal(6),
                                    random.standard_normal(2))
        assert 0.0 <= estimate.mass <= 2.0 and 0.0 < estimate.variance < math.inf


@pytest.mark.parametrize('name', NAMES)
def test_a_reset_forgets_everything(name: str) -> None:
    estimator, random = make_estimator(name, ROBOT, 'paper_reduced', 2), np.random.default_rng(4)
    samples = 1e-3 * random.standard_normal((30, 6))
    runs = []
    for _ in range(2):
        estimator.reset()
        runs.append([estimator.update(0.01 * k, y, y[:2]) for k, y in enumerate(samples)])
    for one, other in zip(*runs):
        assert (one.mass, one.variance, one.p) == (other.mass, other.variance, other.p)


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_rejected_and_the_estimate_kept(name: str, bad: float) -> None:
    estimator, random = make_estimator(name, ROBOT, 'paper_reduced', 2), np.random.default_rng(5)
    for k in range(20):
        last = estimator.update(0.01 * k, 1e-3 * random.standard_normal(6), np.ones(2))
    for channel in range(6):
        output = np.zeros(6)
        output[channel] = bad
        rejected = estimator.update(0.2, output, np.ones(2))
        assert rejected.status == 'input_rejected'
        assert (rejected.mass, rejected.variance, rejected.time) == (
            last.mass, last.variance, 0.2)
    assert estimator.update(0.3, np.zeros(6), np.array([bad, 0.0])).status == 'input_rejected'
    after = estimator.update(0.31, np.zeros(6), np.zeros(2))
    assert after.status != 'input_rejected'
    assert math.isfinite(after.mass) and np.isfinite(after.innovation).all()


@pytest.mark.parametrize('name', NAMES)
def test_nonsense_gives_a_bounded_estimate(name: str) -> None:
    estimator, random = make_estimator(name, ROBOT, 'paper_reduced', 2), np.random.default_rng(6)
    for k in range(300):
        estimate = estimator.update(0.01 * k, random.standard_normal(6),
                                    10 * random.standard_normal(2))
        assert 0.0 <= estimate.mass <= 2.0
        assert 0.0 < estimate.variance < math.inf
    assert estimate.status == 'model_suspect'


def test_bad_settings_are_refused() -> None:
    for call, words in (
        (lambda: SF1Settings(alpha_0=2.0, alpha_1=1.0), 'alpha_0: expected 0 < alpha_0'),
        (lambda: SF1EstimatorSettings(cast(Any, 'other')), 'regression: expected paper'),
        (lambda: SF1Estimator(ROBOT, 'assumed_modes', 2, PAPER_SETTINGS), 'paper_reduced'),
        (lambda: make_estimator('sf1', ROBOT, 'assumed_modes', 3),
         'a gauge a mode on each link, expected at most 2, got 3'),
        (lambda: make_estimator('sf2', ROBOT, 'paper_reduced', 2),
         'estimator: expected one of sf1_paper, sf1'),
        (lambda: make_estimator('sf1', ROBOT, 'paper_reduced', 2).update(
            0.0, np.zeros(5), np.zeros(2)),
         'output: expected 6 numbers'),
    ):
        with pytest.raises(InputError, match=words):
            call()  # type: ignore[no-untyped-call]


@pytest.mark.parametrize('name', NAMES)
def test_samples_that_are_missing_are_predicted(name: str) -> None:
    """Under one command a gap in the stamps is what unusable samples are, up to a second."""
    estimator, random = make_estimator(name, ROBOT, 'paper_reduced', 2), np.random.default_rng(3)
    samples, command = 1e-3 * random.standard_normal((200, 6)), np.array([0.3, -0.2])

    def after(gap: range, told: bool) -> Any:
        estimator.reset()
        for k, y in enumerate(samples):
            if k not in gap:
                found = estimator.update(0.01 * k, y, command)
            elif told:
                estimator.update(0.01 * k, np.full(6, np.nan), command)
        return found

    told, missing = (after(range(60, 90), told) for told in (True, False))
    assert (missing.mass, missing.variance, missing.p) == (told.mass, told.variance, told.p)
    whole = after(range(0), True)
    assert (missing.mass, missing.p) != (whole.mass, whole.p)
    assert after(range(60, 199), False).status == 'not_excited'


def test_slow_samples_are_no_gaps() -> None:
    estimator = make_estimator('sf1', replace(ROBOT, sample_time=1.0), 'paper_reduced', 2)
    samples, found = 1e-3 * np.random.default_rng(2).standard_normal((8, 6)), []
    for step in (1.0, 1.0001):
        estimator.reset()
        found.append([estimator.update(step * k, y, y[:2]) for k, y in enumerate(samples)])
    for even, late in zip(*found):
        np.testing.assert_array_equal(even.innovation, late.innovation)
        np.testing.assert_array_equal(even.innovation_std, late.innovation_std)
