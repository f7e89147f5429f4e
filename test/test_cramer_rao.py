"""The Cramer-Rao bound: sensitivities by finite differences, the bound by other routes."""

from __future__ import annotations

from cramer_rao import linearise, Linearised, payload_bound
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Noise, Simulator
import numpy as np
import pytest

ROBOT = load_robot('reference')
STEPS = 150
NOISE = np.array([1e-3, 1e-3, 5e-7, 5e-7, 5e-7, 5e-7])


def commands() -> Array:
    time = ROBOT.sample_time * np.arange(STEPS)
    return np.stack([0.8 * np.sin(3.0 * time), 0.9 * np.cos(5.0 * time)], axis=1)


def trajectory(arm: ExtendedArm, torque: float = 0.0) -> tuple[Array, Array]:
    """Return states before each step and outputs at every sample, without sensor noise."""
    simulator = Simulator(arm, noise=Noise(torque=torque), seed=3)
    states, outputs = [], [simulator.measure().output]
    for command in commands():
        states.append(simulator.state.copy())
        simulator.step(command)
        outputs.append(simulator.measure().output)
    return np.array(states), np.array(outputs)


def linearised(model: str = 'assumed_modes', torque: float = 0.0) -> Linearised:
    arm = ExtendedArm(ROBOT, model, 2, 0.12)
    return linearise(arm, trajectory(arm, torque)[0], commands())


def output_sensitivity(model: Linearised) -> Array:
    """
    Return dy_k/dm at samples 0 to N, (N + 1, m).

    The state at sample 0 is taken not to depend on the payload.
    """
    x = np.zeros(model.jacobian.shape[-1])
    rows = [model.output @ x]
    for jacobian, slope in zip(model.jacobian, model.slope):
        x = jacobian @ x + slope
        rows.append(model.output @ x)
    return np.array(rows)


@pytest.mark.parametrize('model', ['assumed_modes', 'paper', 'paper_reduced'])
def test_the_sensitivity_is_the_finite_difference_of_whole_simulations(model: str) -> None:
    step, arm = 1e-5, ExtendedArm(ROBOT, model, 2, 0.12)
    after = trajectory(arm.at_payload(0.12 + step))[1]
    before = trajectory(arm.at_payload(0.12 - step))[1]
    found = output_sensitivity(linearised(model))
    expected = (after - before) / (2 * step)
    largest = np.abs(expected).max(axis=0)
    assert largest.min() > 0.0
    np.testing.assert_allclose(found / largest, expected / largest, atol=1e-5)


def test_with_a_known_start_and_no_process_noise_information_adds_up() -> None:
    model = linearised()
    rows = output_sensitivity(model) / NOISE
    expected = np.cumsum(np.sum(rows**2, axis=1))[5:]**-0.5
    found = payload_bound(model, NOISE, np.zeros(12))[5:]
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_it_is_the_batch_weighted_least_squares_of_start_torques_and_payload() -> None:
    steps, n, torque = 40, 12, 0.3
    model = linearised(torque=torque)
    start = np.full(n, 0.05)
    # y = sum of responses to start, every torque and m: one column each, in standard units.
    columns = np.zeros((steps + 1, 6, n + 2 * steps + 1))
    response = np.zeros((n, n + 2 * steps + 1))
    response[:, :n] = np.diag(start)
    for k in range(steps + 1):
        if k:
            response = model.jacobian[k - 1] @ response
            response[:, n + 2 * (k - 1):n + 2 * k] += torque * model.push[k - 1]
            response[:, -1] += model.slope[k - 1]
        columns[k] = (model.output @ response) / NOISE[:, None]
    flat = columns.reshape(-1, columns.shape[-1])
    information = flat.T @ flat
    information[np.arange(n + 2 * steps), np.arange(n + 2 * steps)] += 1.0
    expected = np.linalg.inv(information)[-1, -1]**0.5
    found = payload_bound(model, NOISE, start, (torque, torque))[steps]
    assert found == pytest.approx(expected, rel=1e-6)


def test_more_noise_an_unknown_start_and_no_prior_never_help() -> None:
    model, known = linearised(), np.zeros(12)
    base = payload_bound(model, NOISE, known, prior=0.1)[10:]
    assert (payload_bound(model, 2 * NOISE, known, prior=0.1)[10:] > base).all()
    assert (payload_bound(model, NOISE, known + 0.1, prior=0.1)[10:] > base).all()
    assert (payload_bound(model, NOISE, known, (0.1, 0.1), prior=0.1)[10:] > base).all()
    assert (payload_bound(model, NOISE, known)[10:] >= base).all()
    assert (np.diff(base) <= 0.0).all()
