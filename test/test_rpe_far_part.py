"""One part that is far off its tolerance does not move the payload through all the others."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_payload_estimator.estimators.rpe.far_part import FAR_ODDS, far_part_averaged
from flex_plant_sim.arm.parts import FAR_PART_FACTOR
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
import numpy as np
import pytest
from scipy.stats import multivariate_normal
from truth.records import draw_case, make_record

# Prior deviation of the payload, kg, of the parts, and of the readings.
MASS, PARTS, NOISE = 0.5, np.array([0.1, 0.2, 0.05]), 0.01


def _posterior(std: Array, rows: Array, read: Array) -> tuple[Array, Array, float]:
    """Return mean, covariance and log-evidence of payload and parts by the textbook."""
    prior = np.diag(std**2)
    innovation = rows @ prior @ rows.T + NOISE**2 * np.eye(len(rows))
    gain = prior @ rows.T @ np.linalg.inv(innovation)
    return (gain @ read, prior - gain @ rows @ prior,
            float(multivariate_normal(np.zeros(len(rows)), innovation).logpdf(read)))


@pytest.mark.parametrize('far', [0.0, 0.3, 1.5])
def test_it_is_the_average_of_the_posteriors_with_one_wide_prior_each(far: float) -> None:
    rng = np.random.default_rng(7)
    rows = rng.normal(size=(6, 4))
    read = rows @ np.array([0.3, 0.05, far, 0.01]) + NOISE * rng.normal(size=6)
    std = np.concatenate([[MASS], PARTS])
    each = [_posterior(std * np.where(np.arange(4) == j, FAR_PART_FACTOR, 1.0), rows, read)
            for j in range(1, 4)]
    near = _posterior(std, rows, read)
    log_odds = np.array([near[2], *(e[2] + np.log(FAR_ODDS / 3.0) for e in each)])
    odds = np.exp(log_odds - log_odds.max())
    means, variances = (np.array([near[0][0], *(e[0][0] for e in each)]),
                        np.array([near[1][0, 0], *(e[1][0, 0] for e in each)]))
    mean = odds @ means / odds.sum()
    variance = odds @ (variances + (means - mean)**2) / odds.sum()
    shift, further = far_part_averaged(near[0], near[1], near[0][1:], PARTS, np.zeros(3), 0.0)
    assert near[0][0] + shift == pytest.approx(mean, rel=1e-6)
    assert near[1][0, 0] + further == pytest.approx(variance, rel=1e-6)


def test_the_arm_s_scale_which_no_output_shows_follows_most_of_its_parts() -> None:
    """Of four masses one is three times heavier; least squares take a quarter of it to all."""
    tolerance = np.full(4, 0.05)
    off = np.array([1.05, 0.0, 0.0, 0.0]) - 1.05 / 4.0
    beta = np.array([0.1 * (1.0 - 1.05 / 4.0), *off])
    shift, further = far_part_averaged(beta, np.full((5, 5), 1e-12), off, tolerance, np.ones(4),
                                       0.05**2 / 4.0)
    # The payload as well grows by what all parts but the first are too light.
    assert beta[0] + shift == pytest.approx(0.1, abs=0.008)
    assert 0.0 < further < 0.1 * 0.05


@pytest.mark.parametrize(('effect', 'seed'), [('drive_bandwidth', 4), ('link_stiffness', 3)])
def test_a_slow_drive_and_a_soft_link_move_no_payload(effect: str, seed: int) -> None:
    # Finite elements, whose other parts are off within their tolerances as well.
    case = draw_case(effect, seed, duration_s=4.05)
    record, command = make_record(case), np.zeros(2)
    estimator = RecursivePredictionError(load_robot('reference'))
    for time, joint, strain, sent in zip(record.time, record.joint, record.strain,
                                         record.command):
        found = estimator.update(float(time), np.r_[joint, strain], command)
        command = sent
    assert found.mass == pytest.approx(case.payload_true, rel=0.03)
    # All parts within their tolerances would say otherwise.
    near, _ = estimator.stepper.moments(estimator.incumbent)
    assert abs(near - case.payload_true) > 0.08 * case.payload_true
