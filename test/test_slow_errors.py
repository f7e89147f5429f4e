"""A slow error of a gauge shows at rest and is no model's error, which goes with the motion."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.diagnosis.prediction.latent_view import Finding, latent_view
from flex_plant_sim.diagnosis.prediction.law import hat_functions, LatentSeries, TIME
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base, predictors, slowest_frequency
import numpy as np
import pytest
from scipy.signal import lfilter
from truth.records import make_record, TruthCase
from truth.records import Record as TrueRecord

ROBOT = load_robot('reference')
BASE = nominal_base(ROBOT, 'assumed_modes', 3)
# Columns of one gauge of each link.
COLUMN = {'strain_1a': 0, 'strain_2b': 3}


@cache
def truth() -> TrueRecord:
    """Return the record; every worker imports this file, one runs it."""
    return make_record(TruthCase(9101))


def data_with(gauge: str, zero: np.ndarray) -> Data:
    """Return the record with a gauge's zero that moves, (N,)."""
    strain = truth().strain.copy()
    strain[:, COLUMN[gauge]] += zero
    record = Record('', truth().time, truth().command, np.hstack([truth().joint, strain]), 0.1)
    return Data.of([record], slowest_frequency(BASE, 0.1), ROBOT.sample_time)


def finding_of(gauge: str, zero: np.ndarray) -> Finding:
    """Return what a gauge's error shows where its zero moves, (N,)."""
    return latent_view(predictors(BASE, data_with(gauge, zero))).gauges[COLUMN[gauge]]


@pytest.mark.parametrize('gauge', COLUMN)
def test_a_zero_that_wanders_is_a_law_over_time(gauge: str) -> None:
    """By 4 % of the rms strain: less than a law over the strain needs, that a model may have."""
    size = 0.04 * np.std(truth().strain[:, COLUMN[gauge]])
    wave = np.sqrt(2.0) * size * np.sin(2.0 * np.pi * 0.05 * truth().time)
    found, right = finding_of(gauge, wave), finding_of(gauge, 0.0 * wave)
    assert found.law.stated and found.law.variable == TIME and found.has_shape_of_no_effect
    curve = found.law.at(truth().time[found.series.scored])
    # Few knots round it off.
    assert np.std(curve - wave[found.series.scored]) < 0.5 * size
    assert not right.law.stated and not right.has_shape_of_no_effect


@pytest.mark.parametrize(('gauge', 'size'), [('strain_1a', 6e-5), ('strain_2b', 2e-5)])
@pytest.mark.parametrize('shape', [lambda t: t / t[-1], lambda t: 1.0 - np.exp(-t / 30.0)],
                         ids=['steady', 'warms up'])
def test_a_drift_is_a_law_over_time(gauge: str, size: float,
                                    shape: Callable[[np.ndarray], np.ndarray]) -> None:
    """It grows to 120 and 40 times the gauge's noise, a quarter of its rms strain."""
    found = finding_of(gauge, size * shape(truth().time))
    assert found.law.variable == TIME and found.has_shape_of_no_effect


def test_an_error_that_goes_with_the_motion_is_no_law_over_time() -> None:
    """A gauge may show 5 % too much, which no slow error does."""
    found = finding_of('strain_1a', 0.05 * truth().strain[:, 0])
    assert not found.has_shape_of_no_effect


@pytest.mark.parametrize('knots', [8, 32])
def test_a_table_over_time_has_what_its_means_leave_of_a_model_error(knots: int) -> None:
    """Of an Ornstein-Uhlenbeck process of 30 samples, by drawing it."""
    rng, count, last = np.random.default_rng(2), 20000, 30.0
    keep = np.exp(-1.0 / last)
    error = lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.normal(size=count))
    time = np.arange(float(count))
    series = LatentSeries('strain_1a', 'm/m', error, np.zeros(count), {TIME: ('s', time)},
                          np.ones(count, dtype=bool), 1.0, error_samples=last)
    means = error.reshape(-1, 500).mean(axis=1)
    assert series.model_error_over(TIME, np.zeros(count // 500)) == pytest.approx(
        np.std(means), rel=0.25)
    allowed = series.model_error_over(TIME, np.zeros(knots))
    basis = hat_functions(time, np.linspace(0.0, time[-1], knots))
    curve = basis @ np.linalg.lstsq(basis, error, rcond=None)[0]
    assert np.sqrt(np.mean(curve**2)) < 1.5 * allowed
    assert series.model_error_over('strain', np.zeros(knots)) == 1.0
