"""What the default estimator knows when an arm that was at rest first moves."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_payload_estimator.estimators.rpe.filter import Filter
from flex_payload_estimator.estimators.rpe.likelihood import SCORE
from flex_payload_estimator.estimators.rpe.restarts import hand_over_rest
from flex_payload_estimator.estimators.rpe.time_update import FIRST_BIAS
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Simulator
import numpy as np
from rpe_runs import estimator_of, robot_with

BIAS = np.array([3e-5, -2e-5, 1e-5, 0.0])
SIGMA = 1e-5


def rested(samples: int) -> tuple[RecursivePredictionError, Filter]:
    """Return an estimator beside an arm at rest, and what it knew before its last sample."""
    robot = robot_with(SIGMA)
    estimator, random = estimator_of(robot), np.random.default_rng(4)
    told = np.sqrt(estimator.stepper.told_variance)
    for k in range(samples + 1):
        estimator.conclude()
        before = estimator.incumbent.copy() if k else None
        offset = np.concatenate([[0.1, -0.2], BIAS])
        estimator.update(0.01 * k, offset + told * random.standard_normal(6), np.zeros(2))
    assert before is not None
    return estimator, before


def joint(f: Filter) -> tuple[Array, Array]:
    """Return mean and covariance of readings and gauge biases, all else summed out."""
    size, gauges = f.x.size, slice(FIRST_BIAS, FIRST_BIAS + len(BIAS))
    cross = f.sensitivity @ f.beta_cov
    whole = np.block([[f.cov + cross @ f.sensitivity.T, cross], [cross.T, f.beta_cov]])
    # Of joint 2 the reading is known: angle and its sensor's zero, the column after the biases.
    rows = np.eye(size + f.beta.size)
    rows[1, size + gauges.stop] = 1.0
    rows = rows[np.r_[0:size, size + gauges.start:size + gauges.stop]]
    return rows @ np.concatenate([f.state, f.beta]), rows @ whole @ rows.T


def test_one_filter_serves_at_rest_and_learns_the_gauges() -> None:
    estimator, _ = rested(300)
    f, = estimator._start.filters
    mean, cov = joint(f)
    error, std = mean[-len(BIAS):] - BIAS, np.sqrt(np.diag(cov))[-len(BIAS):]
    assert (np.abs(error) < 4.0 * std).all() and (std < 2.0 * SIGMA).all()


def test_where_it_moves_the_bank_knows_what_the_one_knew_but_the_payload() -> None:
    estimator, before = rested(50)
    start, random = estimator._start, np.random.default_rng(5)
    # As if much of the state owed to the payload and to the gauges.
    before.sensitivity[:] = random.standard_normal(before.sensitivity.shape)
    before.beta_cov[:] += 1e-10 * np.cov(random.standard_normal((before.beta.size, 20)))
    mean, cov = joint(before)
    for f in start.bank(np.zeros(6)):
        mass, variance = f.mass, f.variance
        hand_over_rest(before, f)
        assert np.allclose(joint(f)[0], mean, rtol=1e-12, atol=1e-18)
        assert np.allclose(joint(f)[1], cov, rtol=1e-9, atol=1e-12 * np.abs(cov).max())
        assert (f.mass, f.variance) == (mass, variance)


def test_the_first_motion_fills_the_bank() -> None:
    estimator, _ = rested(50)
    estimator.update(0.51, np.concatenate([[0.11, -0.2], BIAS + 100.0 * SIGMA]), np.zeros(2))
    start = estimator._start
    assert not start.at_rest and {f.mode.name for f in start.filters} == {'exact', 'rough'}


def test_the_estimate_before_any_motion_is_the_prior() -> None:
    estimator, _ = rested(5)
    first = estimator._start.prior_moments
    last = estimator.update(0.06, np.concatenate([[0.1, -0.2], BIAS]), np.zeros(2))
    assert (last.mass, last.variance, last.status) == (*first, 'not_excited')


def test_how_well_a_payload_fitted_at_rest_is_not_handed_over() -> None:
    """It is another payload than the one that is learnt when the arm moves."""
    estimator, before = rested(50)
    before.statistics[SCORE] = [1e3, 2e3, 1e6, 2e3, 10.0, 20.0]
    f = estimator._start.bank(np.zeros(6))[0]
    hand_over_rest(before, f)
    assert not f.statistics[SCORE].any()
    np.testing.assert_array_equal(f.noise_scale, before.noise_scale)


def begun(held: bool) -> tuple[RecursivePredictionError, float]:
    """Return an estimator 0.6 s after a rest of 0.5 s, and when a command began to rise slowly."""
    robot, rest = robot_with(SIGMA), 0.5
    estimator, random = estimator_of(robot), np.random.default_rng(6)
    arm = ExtendedArm(robot, 'assumed_modes', 2, 0.1)
    simulator, command = Simulator(arm), np.zeros(2)
    noise = np.sqrt(estimator.stepper.told_variance)
    for k in range(110):
        output = simulator.measure().output + noise * random.standard_normal(6)
        if held and k < 80:
            output = noise * random.standard_normal(6)
        estimator.update(0.01 * k, output, command)
        command = np.full(2, 0.2 * max(0.01 * k - rest, 0.0))
        if not held or k >= 80:
            simulator.step(command)
    estimator.conclude()
    return estimator, rest


def test_a_window_begins_before_the_motion_did() -> None:
    estimator, rest = begun(held=False)
    window = estimator._competition.window
    assert window.rested is not None
    assert rest - 0.4 < window[window.first].sample.time <= rest


def test_a_window_forgets_the_rest_of_an_arm_that_was_held_while_its_command_rose() -> None:
    estimator, rest = begun(held=True)
    window = estimator._competition.window
    assert window.rested is None and window[window.first].sample.time > rest
