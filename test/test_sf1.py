"""Regression (24)-(28), SF1 (29), and the estimator made of them."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
import math

from flex_payload_estimator.estimators.base import Estimate
from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.estimators.sf1.adaptation import sf1_step
from flex_payload_estimator.estimators.sf1.composite import CompositeMeasurement
from flex_payload_estimator.estimators.sf1.estimator import SF1Estimator
from flex_payload_estimator.estimators.sf1.joint import at_start
from flex_payload_estimator.estimators.sf1.regression import (
    SF1Constants,
    SF1State,
    take_sample,
    update_lag,
)
from flex_payload_estimator.estimators.sf1.settings import Pace, PAPER_SETTINGS
from flex_payload_estimator.model.payload_model import payload_model
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import simulate, Simulator
import numpy as np
from paper_equations import omega_19, omega_exact, split_15
import pytest

ROBOT = load_robot('reference')


def printed_sf1(psi: float, phi: float, theta: float, p: float) -> tuple[float, float]:
    """Return (29) with (30), written as printed."""
    epsilon = psi - phi * theta
    kappa = p * phi / (1 + phi * p * phi)
    forgotten = (2.0 - 0.1) / 2.0 * p + 0.1
    return theta + kappa * epsilon, (1 - kappa * phi) * forgotten


def test_the_update_is_29() -> None:
    random = np.random.default_rng(0)
    mass, found, theta, p = 0.0, 2.0, 0.0, 2.0
    for psi, phi in random.standard_normal((50, 2)):
        theta, p = printed_sf1(psi, phi, theta, p)
        mass, found, _ = sf1_step(mass, found, psi, phi, 1.0, 0.1, 2.0)
        assert mass == pytest.approx(theta, abs=1e-13)
        assert found == pytest.approx(p, rel=1e-13)


def test_p_stays_inside_its_bounds_and_returns_without_excitation() -> None:
    p = [2.0]
    for phi in [30.0] * 200 + [0.0] * 400:
        p.append(sf1_step(0.0, p[-1], 0.0, phi, 1.0, 0.1, 2.0)[1])
    assert 0.0 < min(p) and max(p) <= 2.0
    assert p[-1] == pytest.approx(2.0, rel=1e-6)


@lru_cache(maxsize=1)
def square_commands() -> Array:
    """Return what a proportional controller sends a quiet arm for square set-points, (501, 2)."""
    simulator, rows = Simulator(ExtendedArm(ROBOT, 'paper_reduced', 2, 0.12)), []
    for k in range(501):
        level = 0.5 if k % 400 < 200 else -0.5
        rows.append(4.0 * (level - simulator.measure().angle))
        simulator.step(rows[-1])
    return np.array(rows)


@lru_cache(maxsize=4)
def arm_of(model: str, step: float) -> ExtendedArm:
    """Return the reference arm at a sampling interval."""
    return ExtendedArm(replace(ROBOT, sample_time=step), model, 2)


def driven(step: float, mass: float, noise: float, seed: int, seconds: float,
           told: float = 1.0, model: str = 'paper_reduced') -> list[Estimate]:
    """Return what `sf1` says of its own arm under those commands, held for 10 ms each."""
    arm = arm_of(model, step).at_payload(mass)
    robot = replace(arm.robot, angle_noise=told * noise,
                    strain_noise=told * noise / ROBOT.gauge_amplifier)
    held = np.repeat(square_commands(), max(1, round(0.01 / step)), axis=0)
    held = held[:round(seconds / step) + 1]
    random, scale = np.random.default_rng(seed), np.array([1.0, 1.0, *4 * [
        1 / ROBOT.gauge_amplifier]])
    outputs = simulate(Simulator(arm), held)[0]
    outputs += noise * scale * random.standard_normal(outputs.shape)
    estimator, before = make_estimator('sf1', robot, model, 2), np.vstack([np.zeros(2), held[:-1]])
    return [estimator.update(k * step, output, command)
            for k, (output, command) in enumerate(zip(outputs, before))]


def test_the_variance_is_that_of_the_errors() -> None:
    """Against simulated arms: payloads 0.03 to 0.3 kg, noise over two decades."""
    ratios = []
    for seed in range(30):
        random = np.random.default_rng([seed, 7])
        mass, noise = random.uniform(0.03, 0.3), 10.0**random.uniform(-4.0, -2.0)
        found = driven(0.01, mass, noise, seed, 5.0)
        ratios.append([(found[k].mass - mass) / math.sqrt(found[k].variance)
                       for k in (100, 300, 500)])
    rms = np.sqrt(np.mean(np.square(ratios), axis=0))
    # What 500 runs show (0.92, 0.99, 0.98), and three standard deviations of chi of 30 runs.
    np.testing.assert_allclose(rms, [0.92, 0.99, 0.98], atol=3.0 / math.sqrt(60))


def test_rest_does_not_make_what_noisy_samples_told_surer() -> None:
    """The payload is told in motion, with five times the stated noise; at rest it is as stated."""
    held, noise = square_commands().copy(), 1e-3
    held[150:] = 0.0
    robot = replace(ROBOT, angle_noise=noise, strain_noise=noise / ROBOT.gauge_amplifier)
    outputs = simulate(Simulator(arm_of('paper_reduced', 0.01).at_payload(0.12)), held)[0]
    loud = np.where(np.arange(len(held)) < 200, 5.0, 1.0)[:, None]
    outputs += (loud * noise * np.array([1.0, 1.0, *4 * [1 / ROBOT.gauge_amplifier]])
                * np.random.default_rng(5).standard_normal(outputs.shape))
    estimator = make_estimator('sf1', robot, 'paper_reduced', 2)
    found = [estimator.update(0.01 * k, output, held[max(k - 1, 0)])
             for k, output in enumerate(outputs)]
    # What still swings tells a little more; without it the level would make this a sixteenth.
    assert found[-1].variance > 0.3 * found[200].variance
    assert found[-1].status == 'model_suspect', 'the estimate rests on samples that fit badly'
    assert abs(found[-1].mass - 0.12) < 3.0 * found[-1].variance**0.5


@pytest.mark.parametrize('mass', [0.05, 0.15, 0.45, 0.6])
def test_light_and_heavy_payloads_are_as_well_covered(mass: float) -> None:
    """Three standard deviations of the prior are learnt slowly: the interval says so."""
    found = driven(0.01, mass, 1e-3, 3, 3.0)
    for k in (50, 100, 150, 200, 300):
        assert abs(found[k].mass - mass) < 2.5 * math.sqrt(found[k].variance)
    assert found[100].variance**0.5 < 0.4 * mass


def test_the_lag_is_what_least_squares_say_and_forgetting_keeps_its_second_moment() -> None:
    random, lag, spread = np.random.default_rng(10), 0.0, 1.0
    seen, noise = random.standard_normal(40), random.uniform(0.1, 2.0, 40)
    shown = 1.3 * seen + np.sqrt(noise) * random.standard_normal(40)
    for one in zip(shown, seen, noise):
        lag, spread = update_lag(lag, spread, *one, 1.0)
    weight = 1.0 + np.sum(seen**2 / noise)
    assert lag == pytest.approx(np.sum(seen * shown / noise) / weight, rel=1e-10)
    assert spread == pytest.approx(1.0 / weight, rel=1e-10)
    later, wider = update_lag(lag, spread, 0.7, 0.0, 1.0, 0.9)
    assert later == pytest.approx(0.9 * lag)
    assert later**2 + wider == pytest.approx(lag**2 + spread)


def stated_variance(rows: Array, joint: Array, doubt: Array, lag: float, spread: float) -> Array:
    """Return the variance of the innovations without the sensors' noise, (m,)."""
    swung = (rows @ doubt)**2
    rest = np.maximum(np.diagonal(rows @ joint @ rows.T) - swung, 0.0)
    return np.asarray(rest + (lag**2 + spread) * swung)


@pytest.mark.parametrize('level, own', [(0.5, 3.0), (4.0, 3.0), (4.0, 1.0)])
@pytest.mark.parametrize('lag, spread', [(0.0, 1.0), (0.4, 0.3)])
def test_birges_ratio_widens_variances_and_leaves_the_lag(
        level: float, own: float, lag: float, spread: float) -> None:
    """One regression on two states, beside the Gaussian written out; own: J over the doubt's."""
    random, ratio, misfit = np.random.default_rng(11), max(level, 1.0), 2.0
    output, sensors = np.array([[1.0, 0.3], [0.2, 1.0]]), np.array([0.01, 0.02])
    weights, doubt = np.array([0.7, 0.5]), np.array([0.06, -0.04, 0.2])
    row, part, slope = weights @ output, np.array([0.3, 0.2]), np.array([0.5, -0.1, 0.0])
    start = random.standard_normal((3, 3))
    joint = 1e-3 * start @ start.T + own / 3.0 * np.outer(doubt, doubt)
    track = at_start(np.zeros(2), sensors, np.eye(2), 0.04)
    track.joint[:], track.doubt[:], track.part[0], track.part[1] = joint, doubt, part, slope[:2]
    noise = float(weights**2 @ sensors)
    constants = SF1Constants(
        weights, np.append(row, 0.0), output, np.pad(output, ((0, 0), (0, 1))), sensors,
        np.ones(2), noise, 1.0, float(row @ row) + 1.0, 0.1, 2.0, 2.0, 0.09, 0.0, 0.1, True)
    known = SF1State(0.1, 0.5, 0.04, 8.0, lag, spread, level, misfit)
    scaled, reading = np.array([0.05, 0.11]), np.empty((2, 2))
    surprise, found = take_sample(tuple(track), scaled, True, tuple(known), tuple(constants),
                                  reading)
    add = np.eye(3) + np.outer(slope, [0.0, 0.0, 1.0])
    stated = stated_variance(constants.rows @ add, joint, doubt, lag, spread) + sensors
    np.testing.assert_allclose(reading[1]**2, stated, rtol=1e-12)
    assert surprise == pytest.approx(np.mean(scaled**2 / stated))
    # What the sample says, and what (29) makes of it.
    if lag == 0.0:
        doubt = doubt * np.array([ratio**-0.5, ratio**-0.5, 1.0])
    joint, doubt, line = add @ joint @ add.T, add @ doubt, np.append(row, 0.0)
    e, phi, seen = weights @ scaled, row @ part, line @ doubt
    other = max(line @ joint @ line - seen**2, 0.0) + noise
    weight = 1.0 / spread + seen**2 / other
    lag, spread = (lag / spread + seen * e / other) / weight, 1.0 / weight
    theta, _ = printed_sf1(e + phi * 0.1, phi, 0.1, 0.5)
    kappa = (theta - 0.1) / e
    change = kappa * np.append(part, 1.0)
    onward = np.eye(3) - np.outer(change, line)
    left, last = (onward @ doubt)[2], onward @ joint @ onward.T + noise * np.outer(change, change)
    level += 0.1 * (surprise - level)
    # The misfit is that of the samples that have told of the payload.
    known_now, known_before, without = 1.0 / last[2, 2], 1.0 / joint[2, 2], 1.0 / 0.09
    told = (known_now - known_before) / (known_now - without)
    assert 0.0 < told < 1.0
    misfit += told * (level - misfit)
    variance = max(misfit, 1.0) * (max(last[2, 2] - left**2, 0.0) + spread * left**2)
    expected = (theta, variance + (lag * left)**2, lag, spread, level, misfit)
    np.testing.assert_allclose([found[k] for k in (0, 2, 4, 5, 6, 7)], expected, rtol=1e-10)


@pytest.mark.parametrize('step, model', [
    (2e-3, 'paper_reduced'), (5e-3, 'assumed_modes'), (2e-3, 'assumed_modes')])
def test_the_answer_does_not_depend_on_the_sampling_rate(step: float, model: str) -> None:
    slow, fast = (driven(each, 0.12, 1e-3, 1, 3.0, model=model)[-1] for each in (0.01, step))
    assert fast.variance**0.5 == pytest.approx(slow.variance**0.5, rel=0.05)
    assert abs(fast.mass - 0.12) < 4.0 * fast.variance**0.5 < 0.004


@pytest.mark.parametrize('model', ['paper_reduced', 'assumed_modes'])
def test_faster_samples_start_alike(model: str) -> None:
    """What the first second tells of a payload is one step of 10 ms each, however many samples."""
    slow, fast = (driven(each, 0.12, 1e-4, 1, 1.0, model=model) for each in (0.01, 1e-3))
    for time in (0.1, 0.2, 0.5, 1.0):
        one, other = slow[round(time / 0.01)], fast[round(time / 1e-3)]
        assert other.variance == pytest.approx(one.variance, rel=0.15)
        assert abs(other.mass - one.mass) < 0.5 * one.variance**0.5


def test_a_payload_held_at_its_limit_is_not_known_better_for_it() -> None:
    """The first half second would take the estimate far below zero, where it stays at zero."""
    found = driven(0.01, 0.29, 5e-3, 0, 1.0, model='assumed_modes')
    assert max(estimate.mass for estimate in found[:40]) < 1e-3
    assert all(abs(e.mass - 0.29) < 3.0 * math.sqrt(e.variance) for e in found)


@pytest.mark.parametrize('step, share', [(0.1, 10.0), (0.01, 1.0), (0.003, 0.9), (1e-4, 1.0)])
def test_faster_samples_are_regressed_at_the_pace_of_the_constants(step: float, share: float
                                                                   ) -> None:
    pace = Pace.of(step, 'resolvent')
    assert pace.share == pytest.approx(share)
    assert pace.samples * step == pytest.approx(share * 0.01)
    assert Pace.of(step, 'paper') == Pace(1, 1.0)


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


@pytest.mark.parametrize('terms', [1, 3, 5, 15])
@pytest.mark.parametrize('exact', [True, False])
def test_the_prediction_is_25(terms: int, exact: bool) -> None:
    """With the limit of (19) where the step is halved; as printed with its n' terms."""
    estimator = SF1Estimator(ROBOT, 'paper_reduced', 2,
                             replace(PAPER_SETTINGS, exact=exact, terms=terms))
    random = np.random.default_rng(3)
    scale = estimator.model.scale
    first, second = random.standard_normal((2, 6)) * 0.1 / scale
    estimator.update(0.0, first, np.zeros(2))
    x = 0.1 * random.standard_normal(10)
    assert estimator.track is not None
    estimator.known = estimator.known._replace(mass=0.12)
    estimator.track = estimator.track._replace(state=x)
    u, step, c = np.array([0.4, -0.7]), 0.01, estimator.model.output
    split = split_15(ROBOT, 2, first[1], 0.12)
    a = split[0] + 0.12 * split[1]
    big = omega_exact(a, step) if exact else omega_19(a, step, terms)
    a_0, a_m, b_0, b_m = (big @ part for part in split)
    p = estimator.track.covariance
    s = c @ p @ c.T + 1e-4 * np.eye(6)
    gain = (np.eye(10) + step * big @ a) @ p @ c.T @ np.linalg.inv(s) / step
    x_0 = (np.eye(10) + step * a_0 - step * gain @ c) @ x + step * b_0 @ u \
        + step * gain @ (scale * first)
    x_m = step * a_m @ x + step * b_m @ u
    composite = estimator.composite
    psi = composite.weights @ (scale * second) - composite.row @ x_0
    theta, p_1 = printed_sf1(psi, composite.row @ x_m, 0.12, 2.0)
    estimate = estimator.update(step, second, u)
    np.testing.assert_allclose(estimator.track.state, x_0 + 0.12 * x_m, atol=1e-11)
    assert estimate.mass == pytest.approx(min(max(theta, 0.0), 2.0), abs=1e-10)
    assert estimate.p == pytest.approx(p_1, rel=1e-10)
    np.testing.assert_allclose(estimate.innovation, second - c @ (x_0 + 0.12 * x_m) / scale,
                               atol=1e-12)
