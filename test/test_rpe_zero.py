"""The default estimator where joint 2's sensor has another zero than told, or its zero slips."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

from flex_payload_estimator.estimators.base import Estimate
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_payload_estimator.estimators.rpe.filter import Filter
from flex_payload_estimator.estimators.rpe.modes import EXACT, ROUGH
from flex_payload_estimator.estimators.rpe.prior import ZERO_STD
from flex_payload_estimator.estimators.rpe.restarts import restarted
from flex_payload_estimator.estimators.rpe.zero import ANYWHERE, slip
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.payload_profile import PayloadProfile
import numpy as np
import pytest
from rpe_runs import estimator_of, robot_with, Run
from truth.records import draw_case, make_record

# Column of the zero in beta of an arm with four gauges.
ZERO = 6


@lru_cache(maxsize=1)
def reference() -> RecursivePredictionError:
    return RecursivePredictionError(load_robot('reference'), 'assumed_modes', 3)


@lru_cache(maxsize=4)
def finite_elements(seed: int, zero: float) -> tuple[float, tuple[Array, ...]]:
    """Return the payload, kg, and time, readings and commands of 12 s of a finite-element arm."""
    case = draw_case(None, seed, duration_s=12.05)
    offset = (('angle_offset', {'joint': 2, 'offset': zero}),)
    record = make_record(replace(case, effects=offset if zero else ()))
    before = np.vstack([np.zeros((1, 2)), record.command[:-1]])
    return case.payload_true, (record.time, np.hstack([record.joint, record.strain]), before)


def answers(seed: int, zero: float, slips: Array) -> tuple[float, list[Estimate]]:
    """Return the payload and the answers where joints' readings slip at 6 s, rad, (2,)."""
    payload, (time, output, command) = finite_elements(seed, zero)
    output = output.copy()
    output[time >= 6.0, :2] += slips
    reference().reset()
    return payload, [reference().update(*row) for row in zip(time.tolist(), output, command)]


@pytest.mark.parametrize('zero', [0.05, -0.1, 0.2])
def test_a_zero_that_is_off_is_found_and_the_payload_is_right(zero: float) -> None:
    payload, found = answers(31, zero, np.zeros(2))
    error = np.array([e.mass for e in found[200:]]) - payload
    std = np.array([e.variance for e in found[200:]])**0.5
    assert (np.abs(error) < 3.0 * std).all()
    assert abs(error[-1]) < 3.0 * std[-1] < 0.2 * payload
    # The prior draws what is many tolerances off towards zero.
    assert reference().incumbent.beta[ZERO] == pytest.approx(zero, abs=0.01 + 0.1 * abs(zero))
    assert found[-1].status == ('ok' if abs(zero) < 0.15 else 'model_suspect')


@pytest.mark.parametrize('size', [0.2, -0.05])
def test_a_slip_moves_the_zero_and_not_the_payload(size: float) -> None:
    payload, found = answers(32, 0.0, np.array([0.0, size]))
    error = np.array([e.mass for e in found[600:]]) - payload
    std = np.array([e.variance for e in found[600:]])**0.5
    assert (np.abs(error) < 3.0 * std).all() and (np.abs(error) < 0.08 * payload).all()
    assert reference().incumbent.beta[ZERO] == pytest.approx(size, abs=0.015)
    assert not reference().events


def test_joint_1_has_no_zero_in_the_plane() -> None:
    payload, found = answers(32, 0.0, np.array([0.2, 0.0]))
    error = np.array([e.mass for e in found[600:]]) - payload
    std = np.array([e.variance for e in found[600:]])**0.5
    assert (np.abs(error) < 3.0 * std).all() and not reference().events
    assert abs(reference().incumbent.beta[ZERO]) < 0.02


def test_an_exact_model_keeps_what_it_knows_when_the_zero_slips() -> None:
    estimator, robot = estimator_of(), robot_with()
    run = Run(estimator, PayloadProfile.constant(0.12), 6.0)
    estimator.reset()
    random, found = np.random.default_rng(1), []
    noise = np.array([robot.angle_noise] * 2 + [robot.strain_noise] * 4)
    commands = [np.zeros(2), *run.commands]
    for k, (state, command) in enumerate(zip(run.states, commands)):
        output = estimator.arm.output(state, 0.01 * k) + noise * random.standard_normal(6)
        output[1] += 0.2 * (k >= 300)
        found.append(estimator.update(0.01 * k, output, command))
    off = np.array([e.mass - 0.12 for e in found[300:]])
    std = np.array([e.variance for e in found[300:]])**0.5
    assert (np.abs(off) < 3.5 * std).all() and std.max() < 5e-3 and not estimator.events
    assert estimator.incumbent.beta[ZERO] == pytest.approx(0.2, abs=3e-3)


def in_motion(free: bool) -> Filter:
    """Return a filter whose factors are arbitrary."""
    random, stepper = np.random.default_rng(4), estimator_of().stepper
    f = stepper.begin(ROUGH if free else EXACT, np.zeros(6), 0.12, 0.05)
    f.x += random.standard_normal(f.x.size)
    f.sensitivity[:] = random.standard_normal(f.sensitivity.shape) * np.sqrt(
        np.diag(f.cov))[:, None] / np.sqrt(np.diag(f.beta_cov))
    return f


def joint(f: Filter) -> Array:
    """Return the covariance of (x, beta) from its factors."""
    cross = f.sensitivity @ f.beta_cov
    return np.block([[f.cov + cross @ f.sensitivity.T, cross], [cross.T, f.beta_cov]])


@pytest.mark.parametrize('free', [True, False])
def test_a_slip_adds_to_the_variance_of_the_zero_alone(free: bool) -> None:
    f = in_motion(free)
    state, beta, expected = f.state, f.beta.copy(), joint(f)
    expected[f.x.size + ZERO, f.x.size + ZERO] += ANYWHERE
    slip(f)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(joint(f) / np.outer(scale, scale),
                               expected / np.outer(scale, scale), atol=1e-6)
    np.testing.assert_allclose(f.state, state, rtol=1e-12)
    np.testing.assert_array_equal(f.beta, beta)


def test_a_restart_with_another_zero_keeps_the_reading() -> None:
    f = in_motion(True)
    f.beta[ZERO] = 0.3
    whole, n = joint(f), f.x.size
    # Rows of the readings: the state, but theta_2 + b for theta_2.
    rows = np.eye(n, n + f.beta.size)
    rows[1, n + ZERO] = 1.0
    new = restarted(f, ROUGH, 0.0, estimator_of().stepper)
    np.testing.assert_allclose(new.cov, rows @ whole @ rows.T, rtol=1e-9)
    assert new.beta[ZERO] == 0.0
    np.testing.assert_allclose(new.x - f.x, np.eye(n)[1] * 0.3, atol=1e-12)
    # theta_2 is as uncertain as the reading and the zero.
    assert joint(new)[1, 1] == pytest.approx(new.cov[1, 1] + new.beta_cov[ZERO, ZERO])


def test_the_prior_of_the_zero_is_no_smaller_than_a_slip() -> None:
    prior = estimator_of().stepper.prior
    assert prior.zero == ZERO and prior.std[ZERO] == ZERO_STD and prior.scale[ZERO] == 0.0
    loose = replace(robot_with(), tolerances=replace(
        robot_with().tolerances, angle_zero_rad=0.1))
    assert estimator_of(loose).stepper.prior.std[ZERO] == 0.1
