"""The default estimator where a command was not the one told, an arm is pushed, or set back."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Noise, Simulator
import numpy as np
import pytest
from rpe_runs import estimator_of, robot_with, square

AT, LAST = 300, 400


def answered(told: Array, done: Array, back: bool = False) -> tuple[Array, Array]:
    """Return payload and deviation of a run in which sample AT was told and had another."""
    robot = robot_with(2e-4)
    estimator = estimator_of(robot)
    simulator = Simulator(ExtendedArm(robot, 'assumed_modes', 2, 0.1),
                          noise=Noise(robot.angle_noise, robot.strain_noise), seed=4)
    command, found = np.zeros(2), []
    for k in range(LAST + 1):
        if back and k == AT:
            simulator.reset()
        sample = simulator.measure()
        heard = command + told * (k == AT)
        found.append(estimator.update(0.01 * k, sample.output, heard))
        command = 4.0 * (square(0.01 * k) - sample.angle)
        simulator.step(command + done * (k == AT - 1))
    return np.array([e.mass for e in found]), np.sqrt([e.variance for e in found])


@pytest.mark.parametrize('told, done', [
    ([0.0, -9.0], [0.0, 0.0]), ([-1.0, 3.0], [0.0, 0.0]), ([0.0, 0.0], [4.0, -4.0])])
def test_one_wrong_command_or_push_moves_the_payload_by_no_more_than_its_deviation(
        told: list[float], done: list[float]) -> None:
    mass, std = answered(np.array(told), np.array(done))
    assert np.abs(mass[AT:] - mass[AT - 1]).max() < 2.0 * std[AT - 1]
    assert std[AT:].max() < 1.1 * std[AT - 1]
    assert abs(mass[-1] - 0.1) < 3.0 * std[-1]


def test_an_arm_that_is_set_back_to_rest_keeps_its_payload() -> None:
    mass, std = answered(np.zeros(2), np.zeros(2), back=True)
    assert np.abs(mass[AT:] - mass[AT - 1]).max() < 3.0 * std[AT - 1]
    assert std[-1] < 2.0 * std[AT - 1]
    assert abs(mass[-1] - 0.1) < 3.0 * std[-1]
