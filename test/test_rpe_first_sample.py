"""A first sample that is no reading leaves no trace in the default estimator."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.first_sample import FirstSample
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Noise, Simulator
import numpy as np
from numpy.typing import NDArray
import pytest
from rpe_runs import estimator_of, robot_with, square

Array = NDArray[np.float64]
REST_S, LAST = 1.0, 300


def answers(glitch: Array, at: int = 0) -> list[tuple[float, float, str]]:
    """Return payload, deviation and status of an arm at rest for a second, then in motion."""
    robot = robot_with(2e-4)
    estimator = estimator_of(robot)
    simulator = Simulator(ExtendedArm(robot, 'assumed_modes', 2, 0.1),
                          noise=Noise(robot.angle_noise, robot.strain_noise), seed=4)
    command, found = np.zeros(2), []
    for k in range(LAST + 1):
        sample = simulator.measure()
        told = estimator.update(0.01 * k, sample.output + glitch * (k == at), command)
        found.append((told.mass, told.variance**0.5, told.status))
        goal = square(0.01 * k) if 0.01 * k > REST_S else 0.0
        command = 4.0 * (goal - sample.angle)
        simulator.step(command)
    return found


@pytest.mark.parametrize('glitch', [
    [0.0, 0.0, 0.0, 0.0, 3e-4, 0.0], [0.0, 0.4, 0.0, 0.0, 0.0, 0.0],
    [0.3, -0.2, -2e-3, -2e-3, -2e-3, -2e-3]])
def test_a_first_sample_that_the_next_ones_deny_costs_nothing(glitch: list[float]) -> None:
    clean, spoilt = answers(np.zeros(6)), answers(np.array(glitch))
    assert [status for _, _, status in spoilt[3:]] == [status for _, _, status in clean[3:]]
    for k in (200, LAST):
        assert spoilt[k][0] == pytest.approx(clean[k][0], abs=2.0 * clean[k][1])
        assert spoilt[k][1] == pytest.approx(clean[k][1], rel=0.05)


@pytest.mark.parametrize('samples, off', [
    ([0.0, 0.0, 0.0], False), ([1.0, 0.0, 0.0], True), ([0.0, 1.0, 0.0], False),
    ([0.0, 1.0, 2.0], False), ([0.0, 0.05, 0.05], False), ([0.0, 1.0, 1.2], False),
    ([0.0, 1.0, 1.05], True)])
def test_only_a_leap_after_the_first_sample_denies_it(samples: list[float], off: bool) -> None:
    first = FirstSample(np.array([1e-4, 1.0]))
    found = [first.is_off(np.array([sample, 0.0])) for sample in samples]
    assert found == [False, False, off]
    assert not first.is_off(np.array([9.0, 0.0]))
