"""A cause is as large in all of a record; what only looks like one on average need not be."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses
from flex_plant_sim.diagnosis.causes.posterior import Posterior
from flex_plant_sim.diagnosis.likelihood.constancy import (
    CONSTANT_SPREAD,
    CORRELATION_SHARE,
    varying_cause_gain,
    VARYING_SPREAD,
)
from flex_plant_sim.diagnosis.likelihood.evidence import ParameterPrior
from flex_plant_sim.diagnosis.likelihood.prior import imitation_odds
from flex_plant_sim.diagnosis.likelihood.sufficient_statistics import SufficientStatistics, TEMPER
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
import numpy as np
import pytest
from scipy.stats import multivariate_normal
from simulated_records import REFERENCE

RNG = np.random.default_rng(11)
CHANNELS, WINDOWS, LENGTH = 2, 5, 8
SCALE, WIDTH, TOLERANCE = np.array([1.0, 1.5]), 3.0, 0.5
ROW = 10.0 * RNG.standard_normal((CHANNELS, WINDOWS * LENGTH))
PART = RNG.standard_normal((CHANNELS, WINDOWS * LENGTH))
NOISE = SCALE[:, None] * RNG.standard_normal(ROW.shape)
NO_PRIOR = ParameterPrior(*np.zeros((6, 0)))
EMPTY = SufficientStatistics(np.zeros((1, 1, 1)), np.zeros(0), NO_PRIOR, np.zeros(0), 1.0,
                             np.zeros(1))
NOTHING = Fit((), DiscrepancyModel(), np.zeros(0), np.zeros(0), np.ones(1), np.eye(1), EMPTY, 0.0)
MASS, = (h for h in all_hypotheses(REFERENCE) if h.label == 'payload_mass:arm')


def answer(sizes: Array, value: float = 0.8) -> float:
    """Return what p gains by sizes that change, where they are `sizes` in the windows."""
    seen = NOISE - 0.3 * PART - np.repeat(sizes, LENGTH) * ROW
    residual = seen + value * ROW
    rows = np.stack([residual, ROW, PART])
    prior = ParameterPrior(np.zeros(1), np.array([WIDTH]), np.array([-np.inf]),
                           np.array([np.inf]), np.zeros(1, bool), np.zeros(1))
    statistics = SufficientStatistics(
        np.einsum('amn,bmn->mab', rows, rows), np.array([value]), prior, np.array([TOLERANCE]),
        ROW.shape[1], np.zeros(CHANNELS))
    return varying_cause_gain(statistics, SCALE, (residual, rows[1:2], rows[2:]), WINDOWS,
                              [np.array([value])])


def test_the_gain_is_that_of_the_gaussian_it_stands_for() -> None:
    sizes = np.array([0.9, 0.7, 1.0, 0.2, 0.6])
    seen = (NOISE - 0.3 * PART - np.repeat(sizes, LENGTH) * ROW).ravel()
    same = (np.arange(ROW.size) // LENGTH % WINDOWS)[:, None] == np.arange(WINDOWS)

    apart = np.abs(np.arange(WINDOWS)[:, None] - np.arange(WINDOWS))

    def log_density(spread: float) -> float:
        each = 0.8 * spread * same * ROW.ravel()[:, None]
        between = np.exp(-apart / (CORRELATION_SHARE * WINDOWS))
        whole = (np.diag(np.repeat(TEMPER * SCALE**2, ROW.shape[1])) + each @ between @ each.T
                 + WIDTH**2 * np.outer(ROW, ROW) + TOLERANCE**2 * np.outer(PART, PART))
        return float(multivariate_normal(np.zeros(ROW.size), whole).logpdf(seen))

    gain = log_density(VARYING_SPREAD) - log_density(CONSTANT_SPREAD)
    assert answer(sizes) == pytest.approx(gain, rel=1e-9)


def test_sizes_that_hold_speak_for_a_cause_and_those_that_change_against_it() -> None:
    assert answer(np.full(WINDOWS, 0.8)) < -1.0
    assert answer(np.linspace(0.0, 4.0, WINDOWS)) > 5.0


def test_a_cause_that_nothing_shows_says_nothing() -> None:
    assert answer(np.zeros(WINDOWS), value=0.0) == pytest.approx(0.0)


def test_what_is_not_as_large_in_every_window_is_not_a_cause_alone() -> None:
    base = BaseModel(REFERENCE)
    cause = replace(NOTHING, hypotheses=(MASS,), log_evidence=50.0)
    changing, holding = (Posterior.of([NOTHING, replace(cause, varying_gain=c)], base)
                         for c in (10.0, -10.0))
    assert changing.best.discrepancy.remainder and not holding.best.discrepancy.remainder
    assert changing.effect_probability('payload_mass') == pytest.approx(
        1.0 / (1.0 + imitation_odds(1)), abs=0.01)
    # Where errors are too large as well, they are paid for once.
    loud = replace(cause, error_scale=np.array([1.1]),
                   statistics=replace(NOTHING.statistics, samples=3000.0))
    again = [Posterior.of([NOTHING, replace(loud, varying_gain=c)], base).fits[0].log_evidence
             for c in (-10.0, 10.0)]
    assert again == pytest.approx([50.0, 60.0], abs=0.01)
