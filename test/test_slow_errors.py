"""A slow error of a gauge shows at rest and is no model's error, which goes with the motion."""

from __future__ import annotations

from collections.abc import Callable

from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.diagnosis.causes.gauss_newton import fit_set
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses, CauseSet
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.prior import log_prior_odds
from flex_plant_sim.diagnosis.prediction.latent_view import Finding, latent_view
from flex_plant_sim.diagnosis.prediction.law import hat_functions, LatentSeries, TIME
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base, predictors, slowest_frequency
import numpy as np
import pytest
from scipy.signal import lfilter
from truth.records import make_record, TruthCase

ROBOT = load_robot('reference')
BASE = nominal_base(ROBOT, 'assumed_modes', 3)
TRUTH = make_record(TruthCase(9101))
# Gauges of the reference robot by label; both are on different links.
COLUMN = {'strain_1a': 0, 'strain_2b': 3}


def data_with(gauge: str, zero: np.ndarray) -> Data:
    """Return the record with a gauge's zero that moves, (N,)."""
    strain = TRUTH.strain.copy()
    strain[:, COLUMN[gauge]] += zero
    record = Record('', TRUTH.time, TRUTH.command, np.hstack([TRUTH.joint, strain]), 0.1)
    return Data.of([record], slowest_frequency(BASE, 0.1), ROBOT.sample_time)


def score_of_drift(gauge: str, zero: np.ndarray) -> float:
    """Return by how much a drift is likelier than nothing where a gauge's zero moves, nats."""
    data = data_with(gauge, zero)
    likelihood = Likelihood(BASE, data.windows, data.noise)
    drift, = (h for h in all_hypotheses(ROBOT) if h.label == f'strain_drift:{gauge}')
    found = fit_set(likelihood, CauseSet((drift,), data.duration), (np.zeros(1),))
    nothing = fit_set(likelihood, CauseSet((), data.duration), (np.zeros(0),))
    return found.log_evidence - nothing.log_evidence + log_prior_odds(drift.effect, ROBOT)


@pytest.mark.parametrize('gauge', COLUMN)
@pytest.mark.parametrize('shape', [
    lambda t: 3e-5 * t / t[-1], lambda t: 2.5e-5 * (1.0 - np.exp(-t / 30.0))],
    ids=['steady', 'warms up'])
def test_a_drift_that_shows_at_rest_is_told(
        gauge: str, shape: Callable[[np.ndarray], np.ndarray]) -> None:
    """It is 36 to 60 times the gauge's noise and 4 to 15 % of the rms strain."""
    assert score_of_drift(gauge, shape(TRUTH.time)) > 3.0


@pytest.mark.parametrize('gauge', COLUMN)
def test_an_arm_whose_gauges_are_right_has_no_drift(gauge: str) -> None:
    assert score_of_drift(gauge, np.zeros(TRUTH.time.size)) < -3.0


def test_an_error_that_goes_with_the_motion_is_no_drift() -> None:
    """A gauge may show 5 % too much, which no slow error does: as large as the drifts above."""
    assert score_of_drift('strain_1a', 0.05 * TRUTH.strain[:, 0]) < -3.0


def finding_of(gauge: str, zero: np.ndarray) -> Finding:
    """Return what a gauge's error shows where its zero moves, (N,)."""
    return latent_view(predictors(BASE, data_with(gauge, zero))).gauges[COLUMN[gauge]]


@pytest.mark.parametrize('gauge', COLUMN)
def test_a_zero_that_wanders_is_a_law_over_time(gauge: str) -> None:
    """By 4 % of the rms strain: less than a law over the strain needs, that a model may have."""
    size = 0.04 * np.std(TRUTH.strain[:, COLUMN[gauge]])
    wave = np.sqrt(2.0) * size * np.sin(2.0 * np.pi * 0.05 * TRUTH.time)
    found, right = finding_of(gauge, wave), finding_of(gauge, 0.0 * wave)
    assert found.law.stated and found.law.variable == TIME and found.has_shape_of_no_effect
    curve = found.law.at(TRUTH.time[found.series.scored])
    # Few knots round it off.
    assert np.std(curve - wave[found.series.scored]) < 0.5 * size
    assert not right.law.stated and not right.has_shape_of_no_effect


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
