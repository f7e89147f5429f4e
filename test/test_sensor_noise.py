"""The white noise of a sensor from its record, and how well that is known."""

from __future__ import annotations

from flex_plant_sim.diagnosis.record.sensor_noise import NOISE_ERROR, white_noise
import numpy as np
import pytest


@pytest.mark.parametrize(('samples', 'step'), [(1000, 1e-6), (4000, 0.1), (12000, 1e-6)])
def test_the_noise_found_errs_as_it_is_said_to(samples: int, step: float) -> None:
    """Beside a motion that is slow, and rounded to steps smaller than the noise."""
    rng, time = np.random.default_rng(samples), 0.01 * np.arange(samples)
    motion = 30.0 * np.sin(2.0 * np.pi * 1.3 * time)[:, None]
    measured = np.round((motion + rng.standard_normal((samples, 300))) / step) * step
    found = white_noise(measured)
    assert np.mean(found) == pytest.approx(1.0, rel=0.01)
    # The deviation of 300 draws is known to 4 %.
    assert np.std(found) * np.sqrt(samples) == pytest.approx(NOISE_ERROR, rel=0.12)


@pytest.mark.parametrize('step', [1.2, 1.7, 2.0, 2.2, 2.4, 2.7, 3.2, 4.0, 5.0])
def test_noise_of_less_than_a_step_is_found_with_the_rounding(step: float) -> None:
    """A joint is held, and moves by few steps of its encoder."""
    rng, time = np.random.default_rng(8), 0.01 * np.arange(4000)
    motion = 4.0 * np.sin(2.0 * np.pi * 0.3 * time)[:, None]
    measured = np.round((motion + rng.standard_normal((4000, 100))) / step) * step
    error = np.sqrt(np.mean((measured - motion)**2))
    assert np.mean(white_noise(measured)) == pytest.approx(error, rel=0.05)
