"""A part that changes during a record is told from one that is off all the time."""

from __future__ import annotations

from dataclasses import replace
import math

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.posterior import Posterior, shown_by_parts
from flex_plant_sim.diagnosis.likelihood.constancy import (
    CORRELATION_SHARE,
    PartConstancy,
    window_products,
)
from flex_plant_sim.diagnosis.likelihood.sufficient_statistics import SufficientStatistics, TEMPER
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
import numpy as np
import pytest
from scipy.stats import multivariate_normal
from simulated_records import REFERENCE
from test_constancy import CHANNELS, LENGTH, NO_PRIOR, NOISE, NOTHING, SCALE, WINDOWS

RNG = np.random.default_rng(12)
TOLERANCES = np.array([0.5, 0.2])
PARTS = 8.0 * RNG.standard_normal((2, CHANNELS, WINDOWS * LENGTH))


def seen(course: Array) -> Array:
    """Return the residual of a record in which the first part deviates so in the windows."""
    return NOISE - np.repeat(course, LENGTH) * PARTS[0] + 0.1 * PARTS[1]


def constancy(course: Array) -> PartConstancy:
    """Return what is found of such a record, without a cause."""
    rows = np.concatenate([seen(course)[None], PARTS])
    statistics = SufficientStatistics(
        np.einsum('amn,bmn->mab', rows, rows), np.zeros(0), NO_PRIOR, TOLERANCES,
        PARTS.shape[2], np.zeros(CHANNELS))
    return PartConstancy(statistics, SCALE, (rows[0], np.zeros((0, *rows[0].shape)), PARTS),
                         window_products(PARTS, WINDOWS))


def test_the_gain_is_that_of_the_gaussian_it_stands_for() -> None:
    course = np.array([0.4, 0.3, -0.1, -0.2, -0.5])
    same = (np.arange(PARTS[0].size) // LENGTH % WINDOWS)[:, None] == np.arange(WINDOWS)
    apart = np.abs(np.arange(WINDOWS)[:, None] - np.arange(WINDOWS))
    between = np.exp(-apart / (CORRELATION_SHARE * WINDOWS))

    def log_density(varying: int | None) -> float:
        whole = np.diag(np.repeat(TEMPER * SCALE**2, PARTS.shape[2]))
        for k, (size, row) in enumerate(zip(TOLERANCES, PARTS.reshape(2, -1))):
            each = size * same * row[:, None]
            whole += size**2 * np.outer(row, row) + (k == varying) * each @ between @ each.T
        return float(multivariate_normal(np.zeros(len(whole)), whole).logpdf(seen(course).ravel()))

    expected = [log_density(k) - log_density(None) for k in (0, 1)]
    assert constancy(course).gains == pytest.approx(expected, rel=1e-9)


def test_a_part_that_changes_is_found_with_its_course_and_one_that_holds_is_not() -> None:
    course = np.linspace(0.6, -0.6, WINDOWS)
    changing = constancy(course)
    assert np.argmax(changing.gains) == 0 and changing.gains[0] > 10.0
    found = changing.course(0)
    assert found[-1] - found[0] == pytest.approx(-1.2, abs=0.3)
    assert np.all(constancy(np.full(WINDOWS, 0.6)).gains < 0.5)


def test_a_change_that_shows_is_something_unknown_and_none_costs_nothing() -> None:
    base = BaseModel(REFERENCE)
    shown, hidden = (replace(NOTHING, varying_part_gains=np.array(gains))
                     for gains in ((30.0, 0.0), (0.0, -0.5)))
    assert shown_by_parts(shown) == pytest.approx(30.0 - math.log(2.0))
    assert shown_by_parts(hidden) == -math.inf
    assert Posterior.of([shown], base, parts_vary=True).unknown_probability > 0.99
    assert Posterior.of([hidden], base, parts_vary=True).nothing_probability == 1.0
    assert Posterior.of([shown], base).nothing_probability == 1.0
