"""Lines in the spectrum of a latent force."""

from __future__ import annotations

from flex_plant_sim.diagnosis.prediction.latent_line import line_of, SpectralLine
from flex_plant_sim.diagnosis.prediction.law import LatentSeries
import numpy as np
import pytest

STEP = 0.01


def line(count: int, hertz: float = 3.0) -> SpectralLine | None:
    time = STEP * np.arange(count)
    value = np.sin(2.0 * np.pi * hertz * time) + 0.1 * np.random.default_rng(5).normal(size=count)
    return line_of(LatentSeries('joint_1', 'N m', value, np.full(count, 0.01), {},
                                np.ones(count, dtype=bool), 0.1), STEP)


def test_an_oscillation_is_a_line_at_its_frequency() -> None:
    found = line(4000)
    assert found and found.frequency == pytest.approx(3.0, abs=1.0 / (4000 * STEP / 8))
    assert found.share > 0.9


@pytest.mark.parametrize('count', [8, 100, 144, 335])
def test_a_record_too_short_for_a_background_tells_no_line(count: int) -> None:
    assert line(count) is None
