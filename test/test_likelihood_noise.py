"""The noise that a filter reads from its innovations, where it takes for it more than it reads."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.likelihood import (
    gate_of,
    initial_statistics,
    update_statistics,
)
import numpy as np
import pytest

TOLD = np.array([1e-8, 1e-8, 1e-14, 1e-14])


@pytest.mark.parametrize('least', [1.0, 0.01])
@pytest.mark.parametrize('start', [0.1, 1.0])
def test_the_noise_is_read_right_whatever_the_filter_takes_for_it(
        start: float, least: float) -> None:
    # As at rest: the filter expects its noise and a little of its own.
    random, statistics = np.random.default_rng(8), initial_statistics(4)
    statistics[:4], before, read = start, np.zeros(4), []
    for _ in range(4000):
        innovation = np.sqrt(TOLD) * random.standard_normal(4)
        variances = TOLD * (np.maximum(statistics[:4], least) + 0.05)
        update_statistics(statistics, innovation, before, variances,
                          innovation / np.sqrt(variances), float(np.log(variances).sum()), TOLD,
                          least, gate_of(4), 0.01)
        before = innovation
        read.append(statistics[:4].copy())
    # The memory is 50 samples, of two channels each: a deviation of 0.1 to 0.2 at a time.
    np.testing.assert_allclose(np.mean(read[500:], axis=0), 0.95, atol=0.1)
