"""By how much the default estimator multiplies its variance where errors are correlated."""

from __future__ import annotations

import math

from flex_payload_estimator.estimators.rpe.score import (
    bending_error,
    BENDING_SHARE,
    CORRELATION_S,
    PRIOR_S,
    score_ratio,
    update_score,
)
import numpy as np
import pytest

STEP = 0.01


def learnt(errors: np.ndarray, variance: float) -> tuple[float, np.ndarray]:
    """Return mean of a constant zero, by recursive least squares, and its score's sums."""
    sums, mean, before = np.zeros(6), 0.0, 1e4 * variance
    for error in errors.tolist():
        after = 1.0 / (1.0 / before + 1.0 / variance)
        change = after / variance * (error - mean)
        update_score(sums, change, before, after, 0.0, STEP)
        mean, before = mean + change, after
    return mean, sums


def ratio_of(sums: np.ndarray) -> float:
    """Return the ratio of very long records."""
    return score_ratio(sums, 1e9)


def coloured(correlation: float, runs: int, samples: int) -> np.ndarray:
    """Return first-order errors of unit variance, (runs, samples)."""
    random = np.random.default_rng(7)
    errors = random.standard_normal((runs, samples))
    for k in range(1, samples):
        errors[:, k] = correlation * errors[:, k - 1] \
            + math.sqrt(1.0 - correlation**2) * errors[:, k]
    return errors


@pytest.mark.parametrize('correlation', [0.0, 0.6, 0.9])
def test_the_score_tells_the_variance_of_a_mean_of_coloured_errors(correlation: float) -> None:
    runs = [learnt(errors, 1.0) for errors in coloured(correlation, 60, 3000)]
    ratio = np.mean([ratio_of(sums) for _, sums in runs])
    # Of a first-order process, the sum of correlation^|j| exp(-|j| T / CORRELATION_S).
    faded = correlation * math.exp(-STEP / CORRELATION_S)
    assert ratio == pytest.approx((1.0 + faded) / (1.0 - faded), rel=0.06)
    # By that the mean varies more than it states, 1 / N, less what the memory does not reach.
    spread = 3000 * np.mean([mean**2 for mean, _ in runs])
    assert spread / ratio == pytest.approx(1.0, abs=3.0 * math.sqrt(2.0 / 60.0) + 0.1)


def test_the_score_is_the_mean_square_of_white_errors_whatever_is_stated() -> None:
    errors = coloured(0.0, 40, 3000)
    low, high = (np.array([ratio_of(learnt(run, variance)[1]) for run in errors])
                 for variance in (4.0, 0.25))
    assert high == pytest.approx(16.0 * low)
    # 60 memories a run: as many degrees of freedom.
    assert high.mean() == pytest.approx(4.0, rel=3.0 * math.sqrt(2.0 / 60.0 / 40.0))


def test_nothing_is_known_of_the_score_before_the_first_sample() -> None:
    sums = np.zeros(6)
    update_score(sums, 0.0, 0.0, 0.0, 0.0, STEP)
    assert score_ratio(sums, 0.0) == 1.0


def test_the_score_is_the_same_with_and_without_numba() -> None:
    plain, fast = np.zeros(6), np.zeros(6)
    for change, before, after in ((0.02, 4e-3, 1e-3), (-0.01, 1e-3, 9e-4), (3e-3, 9e-4, 8e-4)):
        update_score(fast, change, before, after, 0.0, STEP)
        getattr(update_score, 'py_func', update_score)(plain, change, before, after, 0.0, STEP)
    assert fast == pytest.approx(plain, rel=1e-14)
    first = np.zeros(6)
    update_score(first, 0.02, 4e-3, 1e-3, 0.0, STEP)
    # The change's variance is 4e-3 - 1e-3, the information gained 1000 - 250.
    assert first == pytest.approx([10.0, 750.0, 100.0, 750.0, 0.0, 0.0])
    assert ratio_of(first) == pytest.approx(0.02**2 / 3e-3)
    # Half of it is prior, that the variance is as stated.
    assert score_ratio(first, PRIOR_S) == pytest.approx(0.5 + 0.5 * 0.02**2 / 3e-3)


def test_bending_counts_by_its_square_and_by_what_was_learnt_from_it() -> None:
    sums, before = np.zeros(6), 1.0
    assert bending_error(sums) == 0.0
    # As much is learnt in ten seconds from 0.3 rad as in ten from 0.1 rad, and none at rest.
    for square in np.repeat([0.09, 0.01, 0.0], 1000).tolist():
        after = 1.0 / (1.0 / before + 1.0)
        update_score(sums, 0.0, before, after, square, STEP)
        before = after
    expected = BENDING_SHARE * (0.09**2 + 0.01**2) / (0.09 + 0.01)
    # The memory of what is learnt lasts for 0.25 s.
    assert bending_error(sums) == pytest.approx(expected, rel=0.03)
