"""A cause is as large in all of a record; what only looks like one on average need not be."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.likelihood.constancy import CHANGES, gained, HOLDS, SLOWLY
from flex_plant_sim.diagnosis.likelihood.evidence import Slab
from flex_plant_sim.diagnosis.likelihood.moments import Moments, TEMPER
import numpy as np
import pytest
from scipy.stats import multivariate_normal

RNG = np.random.default_rng(11)
CHANNELS, WINDOWS, LENGTH = 2, 5, 8
SCALE, WIDTH, TOLERANCE = np.array([1.0, 1.5]), 3.0, 0.5
ROW = 10.0 * RNG.standard_normal((CHANNELS, WINDOWS * LENGTH))
PART = RNG.standard_normal((CHANNELS, WINDOWS * LENGTH))
NOISE = SCALE[:, None] * RNG.standard_normal(ROW.shape)


def answer(sizes: Array, value: float = 0.8) -> float:
    """Return what p gains by sizes that change, where they are `sizes` in the windows."""
    seen = NOISE - 0.3 * PART - np.repeat(sizes, LENGTH) * ROW
    residual = seen + value * ROW
    rows = np.stack([residual, ROW, PART])
    slab = Slab(np.zeros(1), np.array([WIDTH]), np.zeros(1), np.zeros(1, bool))
    moments = Moments(np.einsum('amn,bmn->mab', rows, rows), np.array([value]), slab,
                      np.array([TOLERANCE]), ROW.shape[1], np.zeros(CHANNELS))
    return gained(moments, SCALE, (residual, rows[1:2], rows[2:]), WINDOWS, [np.array([value])])


def test_the_gain_is_that_of_the_gaussian_it_stands_for() -> None:
    sizes = np.array([0.9, 0.7, 1.0, 0.2, 0.6])
    seen = (NOISE - 0.3 * PART - np.repeat(sizes, LENGTH) * ROW).ravel()
    same = (np.arange(ROW.size) // LENGTH % WINDOWS)[:, None] == np.arange(WINDOWS)

    apart = np.abs(np.arange(WINDOWS)[:, None] - np.arange(WINDOWS))

    def log_density(spread: float) -> float:
        each = 0.8 * spread * same * ROW.ravel()[:, None]
        between = np.exp(-apart / (SLOWLY * WINDOWS))
        whole = (np.diag(np.repeat(TEMPER * SCALE**2, ROW.shape[1])) + each @ between @ each.T
                 + WIDTH**2 * np.outer(ROW, ROW) + TOLERANCE**2 * np.outer(PART, PART))
        return float(multivariate_normal(np.zeros(ROW.size), whole).logpdf(seen))

    assert answer(sizes) == pytest.approx(log_density(CHANGES) - log_density(HOLDS), rel=1e-9)


def test_sizes_that_hold_speak_for_a_cause_and_those_that_change_against_it() -> None:
    assert answer(np.full(WINDOWS, 0.8)) < -1.0
    assert answer(np.linspace(0.0, 4.0, WINDOWS)) > 5.0


def test_a_cause_that_nothing_shows_says_nothing() -> None:
    assert answer(np.zeros(WINDOWS), value=0.0) == pytest.approx(0.0)
