"""Regression (24)-(28), SF1 (29), and the estimator made of them."""

from __future__ import annotations

from dataclasses import replace
import math
from typing import Any, cast

from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.estimators.sf1.adaptation import (
    Regressor,
    sf1_update,
    SF1Settings,
    SF1State,
)
from flex_payload_estimator.estimators.sf1.estimator import (
    PAPER_SETTINGS,
    SF1Estimator,
    SF1EstimatorSettings,
)
from flex_payload_estimator.estimators.sf1.regression import CompositeMeasurement, regression
from flex_payload_estimator.model.delta import omega
from flex_payload_estimator.model.payload_model import payload_model
from flex_plant_sim.arm.robot_file import load_robot
from msg_config.errors import InputError
import numpy as np
import pytest

ROBOT = load_robot('reference')
NAMES = ('sf1_paper', 'sf1')


def printed_sf1(psi: float, phi: float, theta: float, p: float) -> tuple[float, float]:
    """Return (29) with (30), written as printed."""
    epsilon = psi - phi * theta
    kappa = p * phi / (1 + phi * p * phi)
    forgotten = (2.0 - 0.1) / 2.0 * p + 0.1
    return theta + kappa * epsilon, (1 - kappa * phi) * forgotten


def test_the_update_is_29() -> None:
    random = np.random.default_rng(0)
    settings = SF1Settings()
    state, theta, p = SF1State.start(settings), 0.0, 2.0
    for psi, phi in random.standard_normal((50, 2)):
        theta, p = printed_sf1(psi, phi, theta, p)
        state = sf1_update(state, Regressor(psi, phi, phi, 1.0), 1.0, settings, 0.01)
        assert state.mass == pytest.approx(theta, abs=1e-13)
        assert state.p == pytest.approx(p, rel=1e-13)


def test_p_stays_inside_its_bounds_and_returns_without_excitation() -> None:
    settings, p = SF1Settings(), []
    state = SF1State.start(settings)
    for phi in [30.0] * 200 + [0.0] * 400:
        state = sf1_update(state, Regressor(0.0, phi, phi, 1.0), 1.0, settings, 0.01)
        p.append(state.p)
    assert 0.0 < min(p) and max(p) <= settings.alpha_1
    assert p[-1] == pytest.approx(settings.alpha_1, rel=1e-6)


def test_the_variance_is_that_of_the_errors() -> None:
    """The second route: 4000 recursions with their own noise, a wrong phi, and 2 as prior."""
    random = np.random.default_rng(2)
    settings = SF1Settings(variance_0=0.04, drift=0.0)
    errors, variance = 0.2 * random.standard_normal(4000), 0.0
    state = SF1State.start(settings)
    for phi in 0.3 * random.standard_normal(40):
        slope, noise = 0.6 * phi, 0.02**2
        kappa = state.p * phi / (1 + phi * state.p * phi)
        errors = (1 - kappa * slope) * errors - kappa * 0.02 * random.standard_normal(4000)
        state = sf1_update(state, Regressor(0.0, phi, slope, noise), 1.0, settings, 0.01)
        variance = state.variance
    assert errors.var() / variance == pytest.approx(1.0, abs=4 * math.sqrt(2 / 4000))
    assert state.p > 100 * variance


@pytest.mark.parametrize('modes', [1, 2, 4])
@pytest.mark.parametrize('name', ['paper_reduced', 'assumed_modes'])
def test_the_composite_measurement_is_a_sum_of_the_measurements(name: str, modes: int) -> None:
    model = payload_model(ROBOT, name, modes)
    composite = CompositeMeasurement.end_point(model)
    np.testing.assert_allclose(composite.weights @ model.output, composite.row, atol=1e-12)
    if modes <= 2:
        np.testing.assert_allclose(composite.row, model.end_point, atol=1e-8)


def test_the_end_point_is_the_slope_of_the_bent_forearm() -> None:
    """theta_2e of a pose, by a difference quotient of the drawn links."""
    model = payload_model(ROBOT, 'paper_reduced', 2)
    theta, q = np.array([0.2, -0.4]), np.array([0.01, 0.002, -0.02, 0.001])
    beams, h = [link.beam(2) for link in ROBOT.links], 1e-6
    ends = []
    for beam, own in zip(beams, (q[:2], q[2:])):
        w = beam.shape(np.array([beam.length - h, beam.length])) @ own
        ends.append((w[1] - w[0]) / h)
    found = model.end_point @ np.concatenate([theta, q, np.zeros(4)])
    assert found == pytest.approx(theta.sum() + sum(ends), abs=1e-5)


def test_the_prediction_is_25() -> None:
    estimator = SF1Estimator(ROBOT, settings=replace(PAPER_SETTINGS, exact=True))
    random = np.random.default_rng(3)
    scale = estimator.model.scale
    first, second = random.standard_normal((2, 6)) * 0.1 / scale
    estimator.update(0.0, first, np.zeros(2))
    estimator.sf1 = estimator.sf1._replace(mass=0.12)
    estimator.state = x = 0.1 * random.standard_normal(10)
    u, step, c = np.array([0.4, -0.7]), 0.01, estimator.model.output
    split = estimator.model.split(math.cos(first[1]), 0.12, 'paper')
    big = omega(split.a, step, 15, estimator.halvings)
    a_0, a_m, b_0, b_m = (big @ part for part in (split.a_0, split.a_m, split.b_0, split.b_m))
    p = estimator.kalman.covariance
    s = c @ p @ c.T + 1e-4 * np.eye(6)
    gain = (np.eye(10) + step * big @ split.a) @ p @ c.T @ np.linalg.inv(s) / step
    x_0 = (np.eye(10) + step * a_0 - step * gain @ c) @ x + step * b_0 @ u \
        + step * gain @ (scale * first)
    x_m = step * a_m @ x + step * b_m @ u
    y = estimator.composite.weights @ (scale * second)
    psi, phi = regression(estimator.composite.row, y, x_0, x_m)
    theta, p_1 = printed_sf1(psi, phi, 0.12, 2.0)
    estimate = estimator.update(step, second, u)
    np.testing.assert_allclose(estimator.state, x_0 + 0.12 * x_m, atol=1e-11)
    assert estimate.mass == pytest.approx(min(max(theta, 0.0), 2.0), abs=1e-10)
    assert estimate.p == pytest.approx(p_1, rel=1e-10)
    np.testing.assert_allclose(estimate.innovation, second - c @ (x_0 + 0.12 * x_m) / scale,
                               atol=1e-12)


@pytest.mark.parametrize('name', NAMES)
def test_a_reset_forgets_everything(name: str) -> None:
    estimator, random = make_estimator(name, ROBOT), np.random.default_rng(4)
    samples = 1e-3 * random.standard_normal((30, 6))
    runs = []
    for _ in range(2):
        estimator.reset()
        runs.append([estimator.update(0.01 * k, y, y[:2]) for k, y in enumerate(samples)])
    for one, other in zip(*runs):
        assert (one.mass, one.variance, one.p) == (other.mass, other.variance, other.p)


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_rejected_and_the_estimate_kept(name: str, bad: float) -> None:
    estimator, random = make_estimator(name, ROBOT), np.random.default_rng(5)
    for k in range(20):
        last = estimator.update(0.01 * k, 1e-3 * random.standard_normal(6), np.ones(2))
    for channel in range(6):
        output = np.zeros(6)
        output[channel] = bad
        rejected = estimator.update(0.2, output, np.ones(2))
        assert rejected.status == 'input_rejected'
        assert (rejected.mass, rejected.variance, rejected.time) == (
            last.mass, last.variance, 0.2)
    assert estimator.update(0.3, np.zeros(6), np.array([bad, 0.0])).status == 'input_rejected'
    after = estimator.update(0.31, np.zeros(6), np.zeros(2))
    assert after.status != 'input_rejected'
    assert math.isfinite(after.mass) and np.isfinite(after.innovation).all()


@pytest.mark.parametrize('name', NAMES)
def test_nonsense_gives_a_bounded_estimate(name: str) -> None:
    estimator, random = make_estimator(name, ROBOT), np.random.default_rng(6)
    for k in range(300):
        estimate = estimator.update(0.01 * k, random.standard_normal(6),
                                    10 * random.standard_normal(2))
        assert 0.0 <= estimate.mass <= 2.0
        assert 0.0 < estimate.variance < math.inf
    assert estimate.status == 'model_suspect'


def test_an_arm_at_rest_tells_nothing() -> None:
    estimator = make_estimator('sf1', ROBOT)
    estimates = [estimator.update(0.01 * k, np.zeros(6), np.zeros(2)) for k in range(300)]
    assert {e.status for e in estimates} == {'not_excited'}
    variances = np.array([e.variance for e in estimates])
    assert (np.diff(variances[1:]) > 0.0).all()
    assert estimates[-1].mass == 0.0


def test_bad_settings_are_refused() -> None:
    for call, words in (
        (lambda: SF1Settings(alpha_0=2.0, alpha_1=1.0), 'alpha_0: expected 0 < alpha_0'),
        (lambda: SF1EstimatorSettings(cast(Any, 'other')), 'regression: expected paper'),
        (lambda: SF1Estimator(ROBOT, 'assumed_modes', 2, PAPER_SETTINGS), 'paper_reduced'),
        (lambda: make_estimator('sf2', ROBOT), 'estimator: expected one of sf1_paper, sf1'),
        (lambda: make_estimator('sf1', ROBOT).update(0.0, np.zeros(5), np.zeros(2)),
         'output: expected 6 numbers'),
    ):
        with pytest.raises(InputError, match=words):
            call()  # type: ignore[no-untyped-call]
