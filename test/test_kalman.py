"""Predictor (23) in delta form: against the shift form's Riccati equation and scipy's."""

from __future__ import annotations

from dataclasses import replace
import math

from flex_payload_estimator.kalman.predictor import KalmanPredictor
from flex_payload_estimator.kalman.riccati import riccati_step, settled
from flex_payload_estimator.model.delta import delta_model, halvings_for, TERMS
from flex_payload_estimator.model.payload_model import payload_model
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

STEP, ROBOT = 0.01, load_robot('reference')
MODEL = payload_model(ROBOT, 'paper_reduced', 2)
R_1, R_2 = 1e-4 * np.eye(10), 1e-4 * np.eye(6)


def delta(step: float = STEP, cosine: float = math.cos(0.5)) -> tuple[Array, Array]:
    """Return A-bar and B-bar of the reference arm with 0.1 kg."""
    return delta_model(*MODEL.matrices(cosine, 0.1), step, halvings_for(MODEL.radius, step, TERMS))


def update(predictor: KalmanPredictor, a_bar: Array) -> Array:
    """Move P one sample on; return K-bar."""
    predictor.advance(np.zeros(10), a_bar, np.zeros((10, 2)), np.zeros(2), np.zeros(6))
    return predictor.gain


def test_one_update_is_the_shift_form_s() -> None:
    a_bar, _ = delta()
    predictor = KalmanPredictor(MODEL.output, R_1, R_2, STEP)
    f, c = np.eye(10) + STEP * a_bar, MODEL.output
    p = predictor.covariance
    for _ in range(20):
        s = c @ p @ c.T + R_2
        gain = f @ p @ c.T @ np.linalg.inv(s)
        # Joseph's form: the difference of two large matrices would lose five digits.
        p = (f - gain @ c) @ p @ (f - gain @ c).T + R_1 + gain @ R_2 @ gain.T
        np.testing.assert_allclose(STEP * update(predictor, a_bar), gain, rtol=0,
                                   atol=1e-10 * np.abs(gain).max())
        np.testing.assert_allclose(predictor.covariance, p, rtol=0, atol=1e-12 * np.abs(p).max())


def test_the_iteration_settles_at_scipy_s_solution() -> None:
    a_bar, _ = delta()
    predictor = KalmanPredictor(MODEL.output, R_1, R_2, STEP)
    for _ in range(3000):
        update(predictor, a_bar)
    f = np.eye(10) + STEP * a_bar
    expected = solve_discrete_are(f.T, MODEL.output.T, R_1, R_2)
    np.testing.assert_allclose(predictor.covariance, expected, rtol=0,
                               atol=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize('step', [1e-5, 1e-4, 1e-3, 1e-2, 0.1])
def test_the_controller_s_settled_gain_is_scipy_s(step: float) -> None:
    model = payload_model(replace(ROBOT, sample_time=step), 'paper_reduced', 2)
    a_bar, b_bar = delta_model(*model.matrices(1.0, 0.1), step,
                               halvings_for(model.radius, step, TERMS))
    q_1 = model.output[:2].T @ model.output[:2] + np.outer(model.end_point, model.end_point)
    q_2 = 0.005 * np.eye(2)
    gain, cost = settled(a_bar, b_bar, q_1, q_2, step)
    f, g = np.eye(10) + step * a_bar, step * b_bar
    expected = solve_discrete_are(f, g, step * q_1, step * q_2)
    # scipy forms I + T A and loses what T costs.
    digits = 1e-13 / step
    np.testing.assert_allclose(cost, expected, rtol=0, atol=digits * np.abs(expected).max())
    np.testing.assert_allclose(gain, np.linalg.solve(
        step * q_2 + g.T @ expected @ g, g.T @ expected @ f), rtol=0,
        atol=digits * np.abs(gain).max())


def test_what_never_settles_is_said() -> None:
    """A growing mode out of the controls' reach."""
    with pytest.raises(FloatingPointError, match='does not settle'):
        settled(np.diag([-1.0, 1.0]), np.array([[1.0], [0.0]]), np.eye(2), np.eye(1), STEP)


def test_the_covariance_is_that_of_simulated_errors() -> None:
    """The second route: 4000 arms with the assumed noise; their prediction errors' covariance."""
    a_bar, _ = delta()
    random = np.random.default_rng(1)
    predictor = KalmanPredictor(MODEL.output, R_1, R_2, STEP)
    errors = 0.1 * random.standard_normal((4000, 10))
    for _ in range(60):
        seen = errors @ MODEL.output.T + 1e-2 * random.standard_normal((4000, 6))
        gain = update(predictor, a_bar)
        errors = errors + STEP * (errors @ a_bar.T - seen @ gain.T) \
            + 1e-2 * random.standard_normal((4000, 10))
    ratio = errors.var(axis=0) / predictor.covariance.diagonal()
    np.testing.assert_allclose(ratio, 1.0, atol=4.0 * math.sqrt(2.0 / 4000))


def test_the_covariance_stays_symmetric_and_definite_while_the_arm_turns() -> None:
    step = 1e-4
    models = [delta(step, math.cos(angle))[0] for angle in np.linspace(0.0, 3.0, 50)]
    predictor = KalmanPredictor(MODEL.output, 1e-10 * np.eye(10), 1e-8 * np.eye(6), step)
    for k in range(20000):
        update(predictor, models[k % 50])
    p = predictor.covariance
    assert np.abs(p - p.T).max() <= 1e-15 * np.abs(p).max()
    assert np.linalg.eigvalsh(p).min() > 0.0


def test_without_a_measurement_the_covariance_only_grows() -> None:
    a_bar, b_bar = delta()
    predictor = KalmanPredictor(MODEL.output, R_1, R_2, STEP)
    for _ in range(50):
        update(predictor, a_bar)
    before, state = predictor.covariance, np.linspace(-1.0, 1.0, 10)
    command = np.array([1.0, -2.0])
    after = predictor.advance(state, a_bar, b_bar, command, None)
    f = np.eye(10) + STEP * a_bar
    np.testing.assert_allclose(after, f @ state + STEP * b_bar @ command, rtol=1e-12)
    expected = f @ before @ f.T + R_1
    np.testing.assert_allclose(predictor.covariance, expected, rtol=0,
                               atol=1e-12 * np.abs(expected).max())


def test_a_weight_that_is_not_definite_is_refused() -> None:
    a_bar, b_bar = delta()
    with pytest.raises(FloatingPointError, match='positive definite'):
        riccati_step(a_bar, b_bar, np.eye(10), -np.eye(2), np.zeros((10, 10)), STEP)
