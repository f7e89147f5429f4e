"""The recursive-prediction-error estimator: changing payload, rest, gaps, bad input."""

from __future__ import annotations

from dataclasses import replace

from flex_payload_estimator.estimators.rpe.settings import RpeSettings
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.effects import build, parse
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.nominal import nominal_effects
from flex_plant_sim.simulation.payload_profile import PayloadProfile
from flex_plant_sim.simulation.simulator import Noise, Simulator
from msg_config.errors import InputError
import numpy as np
import pytest
from rpe_runs import estimator_of, robot_with, Run, SIGMA, square


@pytest.mark.parametrize(('before', 'after'), [(0.05, 0.2), (0.2, 0.05), (0.1, 0.0)])
def test_a_pick_or_drop_is_found_with_its_time(before: float, after: float) -> None:
    estimator = estimator_of()
    run = Run(estimator, PayloadProfile.step(before, 4.3, after), 6.3)
    event, = estimator.events
    assert event.time == pytest.approx(4.3, abs=0.06) and event.found <= 4.5
    assert abs(run.mass[-1] - after) < 0.05 * before
    late = slice(500, None)
    assert np.mean(np.abs(run.mass - run.truth)[late] < 3 * run.std[late]) > 0.95


def test_a_change_soon_after_another_mode_is_told_as_soon() -> None:
    # Links bend untold: the first seconds are those of free parts, until about 2 s.
    robot = load_robot('reference')
    estimator = estimator_of(robot)
    more = build(parse('foreshortening:arm:share=1'), robot)
    arm = ExtendedArm(robot, 'assumed_modes', 2, 0.195,
                      (*nominal_effects(robot, 'assumed_modes'), more))
    Run(estimator, PayloadProfile.step(0.195, 2.845, 0.242), 3.2, arm=arm)
    event, = estimator.events
    assert event.found < 2.845 + 0.2


def test_a_ramp_is_followed_announced_and_left_behind() -> None:
    estimator = estimator_of()
    run = Run(estimator, PayloadProfile((0.0, 3.0, 5.0, 9.0), (0.05, 0.05, 0.15, 0.15)), 9.0)
    event, = estimator.events
    assert event.time == pytest.approx(3.0, abs=0.3) and event.found < 4.6
    assert event.after == pytest.approx(0.15, rel=0.02)
    error = np.abs(run.mass - run.truth)
    assert error[330:].max() < 0.03
    assert np.mean(error[330:500] < 1.96 * run.std[330:500]) > 0.9
    # It stands still again, and the estimate is exact again.
    assert error[-1] < 4 * run.std[-1] < 1e-3


def test_at_rest_the_variance_grows_and_the_status_says_so() -> None:
    estimator = estimator_of()
    run = Run(estimator, PayloadProfile.constant(0.1), 40.0, moving=3.0)
    assert run.estimates[290].status == 'ok'
    assert run.estimates[-1].status == 'not_excited'
    assert run.std[-1] > 1.5e-3 * np.sqrt(15.0) and (np.diff(run.std[3000:]) > -1e-9).all()
    assert abs(run.mass[-1] - 0.1) < 3 * run.std[-1]


def test_before_any_motion_nothing_is_claimed() -> None:
    estimator = estimator_of()
    run = Run(estimator, PayloadProfile.constant(0.1), 2.0, moving=-1.0)
    assert run.estimates[-1].status == 'not_excited' and run.std[-1] > 0.03


@pytest.mark.parametrize('value', [np.nan, np.inf, 1e300])
@pytest.mark.parametrize('where', ['output', 'command', 'time'])
def test_a_reading_that_is_none_is_rejected_and_the_estimate_kept(
        value: float, where: str) -> None:
    if where == 'time' and value == 1e300:
        pytest.skip('a late time is a gap')
    estimator = estimator_of()
    run = Run(estimator, PayloadProfile.constant(0.1), 2.0)
    last, time = run.estimates[-1], 2.0
    output, command = np.zeros(6), run.commands[-1].copy()
    if where == 'output':
        output[3] = value
    elif where == 'command':
        command[1] = value
    else:
        time = value
    found = estimator.update(time + 0.01, output, command)
    assert found.status == 'input_rejected'
    assert (found.mass, found.variance) == (last.mass, last.variance)
    assert estimator.update(2.02, np.r_[run.states[-1][:2], np.zeros(4)],
                            run.commands[-1]).status != 'input_rejected'


def test_the_first_samples_may_be_none_at_all() -> None:
    estimator = estimator_of()
    for k in range(3):
        found = estimator.update(0.01 * k, np.full(6, np.nan), np.full(2, np.nan))
        assert found.status == 'input_rejected'
        assert np.isfinite([found.mass, found.variance]).all()
    assert estimator.update(0.03, np.zeros(6), np.zeros(2)).status == 'not_excited'


@pytest.mark.parametrize('gap', [0.05, 5.0])
def test_missed_samples_cost_little(gap: float) -> None:
    robot = robot_with()
    estimator = estimator_of(robot)
    run = Run(estimator, PayloadProfile.constant(0.1), 4.0)
    arm = ExtendedArm(robot, 'assumed_modes', 2, 0.1)
    simulator = Simulator(arm, noise=Noise(robot.angle_noise, robot.strain_noise), seed=9)
    simulator.state = run.states[-1]
    command = run.commands[-1]
    for _ in range(round(gap / 0.01)):
        simulator.step(command)
    for _ in range(200):
        sample = simulator.measure()
        found = estimator.update(4.0 + sample.time, sample.output, command)
        command = 4.0 * (square(sample.time) - sample.angle)
        simulator.step(command)
    assert found.status == 'ok' and not estimator.events
    assert abs(found.mass - 0.1) < 4 * found.variance**0.5 < 1e-3


def test_a_prediction_made_ahead_changes_nothing() -> None:
    plain, ahead = estimator_of(), estimator_of()
    run = Run(plain, PayloadProfile.constant(0.1), 2.0)
    simulator = Simulator(ExtendedArm(robot_with(), 'assumed_modes', 2, 0.1),
                          noise=Noise(SIGMA, SIGMA / 2000.0), seed=0)
    for k, expected in enumerate(run.estimates):
        sample = simulator.measure()
        command = run.commands[k - 1] if k else np.zeros(2)
        if k % 3:
            ahead.prepare(command if k % 2 else command + 0.1)
        found = ahead.update(sample.time, sample.output, command)
        assert (found.mass, found.variance) == (expected.mass, expected.variance)
        simulator.step(run.commands[k])


def test_wrong_shapes_and_settings_are_refused() -> None:
    estimator = estimator_of()
    with pytest.raises(InputError, match='expected 6 and 2 numbers'):
        estimator.update(0.0, np.zeros(5), np.zeros(2))
    with pytest.raises(InputError, match='payload_max'):
        RpeSettings(payload_max=0.0)
    with pytest.raises(InputError, match='payload_max: expected a number >= 1e-09 kg'):
        RpeSettings(payload_max=1e-30)
    with pytest.raises(InputError, match='torque_noise'):
        RpeSettings(torque_noise=(-1.0, 0.0))


@pytest.mark.parametrize(('density', 'stiffness', 'payload', 'step'), [
    (0.1, 1.0, 0.3, 0.01), (1.0, 100.0, 0.01, 1e-3)])
def test_noise_alone_tells_no_payload(density: float, stiffness: float, payload: float,
                                      step: float) -> None:
    # Of 240 very different robots (benchmarks/robot_sweep.py) these told most at rest.
    robot = replace(robot_with(2e-4), sample_time=step, payload_mass=payload)
    for j, link in enumerate(robot.links):
        robot = robot.with_link(j, density=density * link.density,
                                youngs_modulus=stiffness * link.youngs_modulus)
    estimator, random = estimator_of(robot), np.random.default_rng(5)
    noise = np.array([2e-4] * 2 + [robot.strain_noise] * 4)
    found = [estimator.update(step * k, noise * random.standard_normal(6), np.zeros(2))
             for k in range(100)]
    assert {answer.status for answer in found} == {'not_excited'}
    assert min(answer.variance for answer in found) >= (1.0 - 1e-9) * found[0].variance
