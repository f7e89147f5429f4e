"""The recursive-prediction-error estimator: bound, coverage, changes, rest, bad input."""

from __future__ import annotations

from dataclasses import replace
import json
from pathlib import Path

from flex_payload_estimator.cramer_rao import linearise, payload_bound
from flex_payload_estimator.estimators.base import Estimate
from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.estimators.rpe import RecursivePredictionError
from flex_payload_estimator.estimators.rpe_kernel import MASS_COLUMNS
from flex_payload_estimator.estimators.rpe_levels import start_spread
from flex_payload_estimator.estimators.rpe_parts import tabulated
from flex_payload_estimator.estimators.rpe_settings import RpeSettings
from flex_plant_sim.arm_model import Array
from flex_plant_sim.effects import build
from flex_plant_sim.errors import InputError
from flex_plant_sim.extended_arm import ExtendedArm
from flex_plant_sim.payload_profile import PayloadProfile
from flex_plant_sim.robot import EffectSpec, load_robot, Robot
from flex_plant_sim.simulation import Noise, Simulator
from flex_plant_sim.state_space import zero_order_hold
import numpy as np
import pytest

SIGMA = 1e-3


def robot_with(sigma: float = SIGMA) -> Robot:
    """Return the reference robot with one noise level, rad and V."""
    robot = load_robot('reference')
    return replace(robot, angle_noise=sigma, strain_noise=sigma / robot.gauge_amplifier)


def square(time: float) -> float:
    return 0.5 if (time + 1e-9) % 4.0 < 2.0 else -0.5


class Run:
    """The estimator beside a simulated arm under P control of its joint angles."""

    def __init__(self, estimator: RecursivePredictionError, profile: PayloadProfile,
                 seconds: float, seed: int = 0, arm: ExtendedArm | None = None,
                 moving: float = np.inf):
        robot = estimator.arm.robot
        noise = Noise(robot.angle_noise, robot.strain_noise, estimator.settings.torque_noise[0])
        simulator = Simulator(arm or ExtendedArm(robot, 'assumed_modes', 2, profile.at(0.0)),
                              profile, noise, seed)
        estimator.reset()
        command = np.zeros(2)
        self.estimates: list[Estimate] = []
        self.states, self.commands = [], []
        for _ in range(round(seconds / robot.sample_time) + 1):
            sample = simulator.measure()
            self.estimates.append(estimator.update(sample.time, sample.output, command))
            goal = square(sample.time) if sample.time < moving else 0.0
            command = 4.0 * (goal - sample.angle)
            if sample.time > moving + 1.0:
                command = np.zeros(2)
            self.states.append(simulator.state.copy())
            self.commands.append(command)
            simulator.step(command)
        self.truth = np.array([profile.at(e.time) for e in self.estimates])
        self.mass = np.array([e.mass for e in self.estimates])
        self.std = np.sqrt([e.variance for e in self.estimates])


def estimator_of(robot: Robot | None = None, modes: int = 2,
                 **changes: object) -> RecursivePredictionError:
    return RecursivePredictionError(robot or robot_with(), 'assumed_modes', modes,
                                    settings=RpeSettings(**changes))  # type: ignore[arg-type]


def test_the_schedule_and_its_derivatives_are_those_of_the_sampled_arm() -> None:
    robot = robot_with()
    schedule, _ = tabulated(replace(robot, angle_noise=1.0, strain_noise=1.0), 'assumed_modes', 2,
                            (), 0.7)
    arm = ExtendedArm(robot, 'assumed_modes', 2)

    def exact(angle: float, mass: float) -> Array:
        f, g, _ = arm.matrices(np.cos(angle), mass)
        return np.hstack([f - np.eye(len(f)), g])

    for angle, mass in ((0.3, 0.0003), (1.9, 0.1), (2.9, 0.35), (0.0, 0.69)):
        piece = schedule.cut(mass)
        away, width = mass - piece.payload, piece.value.shape[1]
        wave = np.cos(angle * schedule.order)
        slope, bend = (wave @ piece.slopes).reshape(2, width)
        found = wave @ piece.value + away * (slope + 0.5 * away * bend)
        size = np.abs(exact(angle, mass)).max()
        np.testing.assert_allclose(found, exact(angle, mass).ravel(), atol=3e-7 * size)
        over_mass = (exact(angle, mass + 1e-6) - exact(angle, mass - 1e-6 * (mass > 0))) / (
            1e-6 * (1 + (mass > 0)))
        np.testing.assert_allclose(slope + away * bend, over_mass.ravel(),
                                   atol=5e-4 * np.abs(over_mass).max())


def test_the_sensitivity_is_the_finite_difference_of_the_predictor() -> None:
    estimator = estimator_of()
    run = Run(estimator, PayloadProfile.constant(0.12), 1.5)
    stepper, h = estimator.stepper, estimator.bank.best()
    sample, step = estimator._sample, 1e-5

    def predicted(shift: float) -> Array:
        moved = h.copy()
        moved.mass, moved.x = h.mass + shift, h.x + shift * h.sens[:, 0]
        stepper.predict(moved, sample)
        return moved.x

    expected = (predicted(step) - predicted(-step)) / (2 * step)
    after = h.copy()
    stepper.predict(after, sample)
    size = np.abs(expected).max()
    assert size > 0.0 and run.mass.size
    np.testing.assert_allclose(after.sens[:, 0], expected, atol=1e-4 * size)


@pytest.mark.parametrize(('sigma', 'torque'), [(1e-2, 0.0), (1e-4, 0.0), (1e-3, 0.05)])
def test_it_reaches_the_bound_on_a_matched_model(sigma: float, torque: float) -> None:
    robot, errors = robot_with(sigma), []
    estimator = estimator_of(robot, torque_noise=(torque, torque))
    for seed, mass in enumerate((0.03, 0.07, 0.13, 0.2, 0.3)):
        run = Run(estimator, PayloadProfile.constant(mass), 3.0, seed)
        arm = ExtendedArm(robot, 'assumed_modes', 2, mass)
        model = linearise(arm, np.array(run.states[:-1]), np.array(run.commands[:-1]))
        noise = [robot.angle_noise] * 2 + [robot.strain_noise] * 4
        bound = payload_bound(model, noise, start_spread(arm), [torque] * 2)
        assert run.std[-1] == pytest.approx(bound[-1], rel=0.02)
        errors.append((run.mass[-1] - mass) / bound[-1])
        assert run.estimates[-1].status == 'ok' and not estimator.events
    # Five standard normal draws exceed this root mean square once in a thousand.
    assert np.sqrt(np.mean(np.square(errors))) < 2.03


@pytest.mark.parametrize('model', ['paper', 'paper_reduced'])
@pytest.mark.parametrize('modes', [1, 2, 4])
def test_every_model_and_number_of_modes(model: str, modes: int) -> None:
    robot = robot_with()
    estimator = make_estimator('rpe', robot, model, modes)
    assert isinstance(estimator, RecursivePredictionError)
    arm = ExtendedArm(robot, model, modes, 0.15)
    run = Run(estimator, PayloadProfile.constant(0.15), 2.0, arm=arm)
    assert abs(run.mass[-1] - 0.15) < 4 * run.std[-1] < 2e-3


@pytest.mark.parametrize(('before', 'after'), [(0.05, 0.2), (0.2, 0.05), (0.1, 0.0)])
def test_a_pick_or_drop_is_found_with_its_time(before: float, after: float) -> None:
    estimator = estimator_of()
    run = Run(estimator, PayloadProfile.step(before, 4.3, after), 6.3)
    event, = estimator.events
    assert event.time == pytest.approx(4.3, abs=0.06) and event.found <= 4.5
    assert abs(run.mass[-1] - after) < 0.05 * before
    late = slice(500, None)
    assert np.mean(np.abs(run.mass - run.truth)[late] < 3 * run.std[late]) > 0.95


def test_a_ramp_is_followed() -> None:
    estimator = estimator_of()
    run = Run(estimator, PayloadProfile((0.0, 3.0, 5.0, 9.0), (0.05, 0.05, 0.15, 0.15)), 9.0)
    assert estimator.events
    assert np.abs(run.mass - run.truth)[300:].max() < 0.05
    assert abs(run.mass[-1] - 0.15) < min(0.005, 3 * run.std[-1])


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
    assert found.status == 'input_rejected' and estimator.rejected == 1
    assert (found.mass, found.variance) == (last.mass, last.variance)
    assert estimator.update(2.02, np.r_[run.states[-1][:2], np.zeros(4)],
                            run.commands[-1]).status != 'input_rejected'


def test_the_first_samples_may_be_none_at_all() -> None:
    estimator = estimator_of()
    for k in range(3):
        found = estimator.update(0.01 * k, np.full(6, np.nan), np.full(2, np.nan))
        assert found.status == 'input_rejected'
        assert np.isfinite([found.mass, found.variance]).all()
    assert estimator.rejected == 3
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


def test_the_covariance_stays_symmetric_positive_definite_at_a_fine_step() -> None:
    robot = replace(robot_with(), sample_time=1e-4)
    estimator = estimator_of(robot)
    arm = ExtendedArm(robot, 'assumed_modes', 2, 0.1)
    run = Run(estimator, PayloadProfile.constant(0.1), 0.3, arm=arm)
    h = estimator.bank.best()
    scale = np.sqrt(np.diag(h.cov))
    assert np.array_equal(h.cov, h.cov.T)
    assert np.linalg.eigvalsh(h.cov / np.outer(scale, scale)).min() > 0.0
    assert h.variance > 0.0 and np.isfinite(run.mass).all()
    assert abs(run.mass[-1] - 0.1) < 4 * run.std[-1]


def test_the_joint_covariance_is_that_of_the_augmented_kalman_filter() -> None:
    # The Riccati recursion of (x, m) at the filter's own estimates, as an independent route.
    estimator = estimator_of()
    robot, arm = estimator.arm.robot, ExtendedArm(robot_with(), 'assumed_modes', 2, 0.1)
    simulator = Simulator(arm, noise=Noise(SIGMA, SIGMA / 2000.0), seed=2)
    stepper, n = estimator.stepper, arm.states
    estimator.update(0.0, simulator.measure().output, np.zeros(2))
    h = min((h for h in estimator.bank.hypotheses if h.level == 0),
            key=lambda h: abs(h.mass - 0.1))
    estimator.bank.hypotheses = [h]
    joint = np.zeros((n + 1, n + 1))
    joint[:n, :n], joint[n, n] = h.cov + h.variance * np.outer(h.sens[:, 0], h.sens[:, 0]), \
        h.variance
    joint[:n, n] = joint[n, :n] = h.variance * h.sens[:, 0]
    output = np.hstack([stepper.output, np.zeros((6, 1))])
    for k in range(1, 60):
        command = np.array([np.sin(0.1 * k), np.cos(0.2 * k)])
        simulator.step(command)
        model = linearise(arm.at_payload(h.mass), h.x[None], command[None])
        step = np.eye(n + 1)
        step[:n, :n], step[:n, n] = model.jacobian[0], model.slope[0]
        joint = step @ joint @ step.T
        gain = joint @ output.T @ np.linalg.inv(output @ joint @ output.T + np.eye(6))
        joint = joint - gain @ output @ joint
        estimator.update(robot.sample_time * k, simulator.measure().output, command)
        assert h.variance == pytest.approx(joint[n, n], rel=1e-4)
    total = h.cov + h.variance * np.outer(h.sens[:, 0], h.sens[:, 0])
    np.testing.assert_allclose(total, joint[:n, :n], rtol=1e-3, atol=1e-4 * np.abs(total).max())


def test_tolerances_widen_the_interval_only_where_the_model_does_not_fit() -> None:
    robot = robot_with()
    stiffer = robot.with_link(1, youngs_modulus=1.03 * robot.links[1].youngs_modulus)
    estimator = estimator_of(robot)
    profile = PayloadProfile.constant(0.15)
    exact = Run(estimator, profile, 3.0)
    off = Run(estimator, profile, 3.0, arm=ExtendedArm(stiffer, 'assumed_modes', 2, 0.15))
    assert exact.std[-1] < 1e-4 and off.std[-1] > 3e-3
    assert abs(off.mass[-1] - 0.15) < 2 * off.std[-1]


def test_the_lean_is_the_effect_of_a_part_on_the_estimate() -> None:
    robot = robot_with(1e-4)
    estimator, profile = estimator_of(robot), PayloadProfile.constant(0.15)
    masses = []
    for change in (0.005, -0.005):
        other = robot.with_link(0, youngs_modulus=(1 + change) * robot.links[0].youngs_modulus)
        run = Run(estimator, profile, 4.0, arm=ExtendedArm(other, 'assumed_modes', 2, 0.15))
        masses.append(run.mass[-1])
    h = estimator.bank.best()
    assert not estimator.stepper.levels[h.level].exact and h.sens.shape[1] > MASS_COLUMNS
    # lean = d(m - estimate)/d(part); the stiffness of the upper link is the first part.
    assert (masses[1] - masses[0]) / 0.01 == pytest.approx(h.lean[0], rel=0.05)


@pytest.mark.parametrize('spec', [
    EffectSpec('coulomb_friction', 'joint_2', {'level_n_m': 0.4}),
    EffectSpec('input_delay', 'arm', {'delay_s': 0.03}),
    EffectSpec('strain_filter', 'arm', {'time_constant_s': 0.04, 'damping': 0.8}),
    EffectSpec('strain_gain', 'strain_2a', {'factor': 0.8})])
def test_the_effects_of_a_robot_file_are_used(spec: EffectSpec) -> None:
    robot = robot_with()
    extended = replace(robot, effects=(spec,))
    arm = ExtendedArm(robot, 'assumed_modes', 2, 0.15, effects=[build(spec, robot)])
    profile = PayloadProfile.constant(0.15)
    knowing = Run(estimator_of(extended), profile, 3.0, arm=arm)
    ignorant = Run(estimator_of(robot), profile, 3.0, arm=arm)
    assert abs(knowing.mass[-1] - 0.15) < 4 * knowing.std[-1] < 4e-3
    assert abs(ignorant.mass[-1] - 0.15) > 2 * abs(knowing.mass[-1] - 0.15)


def test_wrong_shapes_and_settings_are_refused() -> None:
    estimator = estimator_of()
    with pytest.raises(InputError, match='expected 6 and 2 numbers'):
        estimator.update(0.0, np.zeros(5), np.zeros(2))
    with pytest.raises(InputError, match='payload_max'):
        RpeSettings(payload_max=0.0)
    with pytest.raises(InputError, match='torque_noise'):
        RpeSettings(torque_noise=(-1.0, 0.0))


def bench_run(folder: Path, name: str, seconds: float) -> tuple[
        RecursivePredictionError, list[Estimate], dict[str, object]]:
    """Return the default estimator's answers to the first seconds of a record."""
    truth = json.loads((folder / 'truth.json').read_text())[name]
    rows = np.loadtxt(folder / f'{name}.csv', delimiter=',', skiprows=1,
                      max_rows=round(seconds / 0.01) + 1)
    estimator = RecursivePredictionError(load_robot('reference'))
    command, estimates = np.zeros(2), []
    for row in rows:
        estimates.append(estimator.update(row[0], row[3:9], command))
        command = row[1:3]
    return estimator, estimates, truth


def test_on_the_clean_record_of_another_simulator(shared_data: Path) -> None:
    estimator, estimates, truth = bench_run(shared_data / 'bench', 'case_8009d8b8', 10.0)
    true = truth['payload_true']
    assert isinstance(true, float) and not estimator.events
    assert abs(estimates[300].mass / true - 1) < 0.06
    assert abs(estimates[1000].mass / true - 1) < 0.03
    assert abs(estimates[1000].mass - true) < 1.96 * estimates[1000].variance**0.5


def test_on_the_record_with_a_drop(shared_data: Path) -> None:
    estimator, estimates, truth = bench_run(shared_data / 'bench', 'case_76be4577', 14.0)
    effect = truth['effect']
    assert isinstance(effect, dict)
    time, after = effect['payload_drop']
    event, = estimator.events
    assert abs(event.time - time) < 0.1 and time <= event.found < time + 0.2
    assert abs(estimates[round((time + 2.0) / 0.01)].mass / after - 1) < 0.05


def test_zero_order_hold_of_the_increment_loses_no_digits() -> None:
    # What the schedule tabulates: (exp(A T) - I) / T tends to A as T shrinks.
    arm = ExtendedArm(robot_with(), 'assumed_modes', 2)
    a = arm.plant.a[0]
    increment = zero_order_hold(a, a, 1e-9)[1]
    np.testing.assert_allclose(increment / 1e-9, a, atol=1e-5 * np.abs(a).max())
