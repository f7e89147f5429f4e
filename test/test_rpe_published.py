"""What the default estimator publishes of a payload near zero."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.modes import EXACT, Mode, ROUGH
from flex_payload_estimator.estimators.rpe.time_update import FIRST_BIAS, MASS
from flex_payload_estimator.estimators.rpe.zero import zero_column
from flex_plant_sim.interval import Z95
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.payload_profile import PayloadProfile
import numpy as np
import pytest
from rpe_runs import estimator_of, robot_with, Run
from scipy.stats import norm, truncnorm


def test_no_payload_below_zero_is_published() -> None:
    # Half a deviation of payload that a gauge's bias may be instead, averaged with no bias.
    estimator = estimator_of()
    f = estimator.stepper.begin(EXACT, np.zeros(6), 0.001, 0.01)
    std = f.beta_cov.diagonal()**0.5
    f.beta[FIRST_BIAS] = 0.5 * std[FIRST_BIAS]
    for row, column in ((MASS, FIRST_BIAS), (FIRST_BIAS, MASS)):
        f.beta_cov[row, column] = 0.9 * std[MASS] * std[FIRST_BIAS]
    mass, variance = estimator.stepper.moments(f)
    assert mass < -1e-3
    assert estimator.stepper.published(f) == (0.0, variance)


@pytest.mark.parametrize('mode, column, is_averaged', [
    (ROUGH, FIRST_BIAS, True), (ROUGH, zero_column(6), True), (ROUGH, zero_column(6) + 4, True),
    (ROUGH, zero_column(6) + 5, False), (EXACT, FIRST_BIAS, True)])
def test_the_payload_is_averaged_over_biases_zero_and_lasting_forces(
        mode: Mode, column: int, is_averaged: bool) -> None:
    # A bias, the zero, the last of the lasting forces, and the first part, half a deviation off.
    estimator = estimator_of()
    f = estimator.stepper.begin(mode, np.zeros(6), 0.1, 0.01)
    std = f.beta_cov.diagonal()**0.5
    f.beta[column] += 0.5 * std[column]
    f.beta_cov[MASS, column] = f.beta_cov[column, MASS] = 0.5 * std[MASS] * std[column]
    moved = 0.1 - estimator.stepper.moments(f)[0]
    assert (abs(moved) > 1e-6) == is_averaged


def test_zero_serves_an_empty_arm_better_than_the_mean_of_payloads_above_it() -> None:
    # Over estimates of an empty arm in deviations: by quadrature.
    found = np.linspace(-8.0, 8.0, 4001)
    weights = norm.pdf(found) / norm.pdf(found).sum()
    cut = truncnorm(-found, np.inf, loc=found)
    kept = np.maximum(found, 0.0)
    assert (weights @ cut.mean()**2)**0.5 > 1.35 * (weights @ kept**2)**0.5
    assert weights @ cut.mean() > 2.0 * weights @ kept
    # The interval about zero holds it as often as before or more.
    assert weights @ (kept < Z95) > 0.974


def test_a_payload_beyond_the_range_is_not_ok_and_found_where_the_range_is_wider() -> None:
    """A payload of twice the range was half of it at 3 s, eleven deviations off, and `ok`."""
    robot = robot_with()
    narrow, wide = estimator_of(robot), estimator_of(robot, payload_max=2.0)
    assert narrow.payload_max < 0.8
    statuses = {}
    for estimator in (narrow, wide):
        run = Run(estimator, PayloadProfile.constant(1.5), 3.0, 7,
                  ExtendedArm(robot, 'assumed_modes', 2, 1.5))
        statuses[estimator.payload_max] = run.estimates[-1].status
    assert statuses == {narrow.payload_max: 'model_suspect', 2.0: 'ok'}
    assert run.mass[-1] == pytest.approx(1.5, abs=4.0 * run.std[-1]) and run.std[-1] < 0.03


def test_no_band_is_wider_than_the_range_of_payloads() -> None:
    """A payload that nothing is learnt of was published as 0.7 +- 1169 kg."""
    stepper = estimator_of().stepper
    f = stepper.begin(EXACT, np.zeros(6), 0.1, 1e3)
    mass, variance = stepper.published(f)
    middle = 0.5 * stepper.payload_max
    assert 0.0 <= mass <= stepper.payload_max
    assert variance == pytest.approx((mass - middle)**2 + middle**2 / 3.0)
