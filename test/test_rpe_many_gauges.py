"""The default estimator with as many gauges as a robot file may have."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.likelihood import (
    gate_of,
    initial_statistics,
    POOR_FIT,
    reduced_chi_square,
    update_statistics,
)
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Noise, Simulator
import numpy as np
import pytest
from rpe_runs import estimator_of, robot_with, square
from scipy.stats import chi2

PAYLOAD = 0.1


def robot_of(gauges: int) -> Robot:
    """Return the reference robot with so many gauges a link."""
    robot = robot_with(2e-4)
    for j, link in enumerate(robot.links):
        robot = robot.with_link(
            j, gauge_positions=tuple(np.linspace(0.0, 0.9 * link.length, gauges)))
    return robot


@pytest.mark.parametrize('channels', [2, 4, 6, 22, 42])
def test_as_many_samples_are_beyond_the_gate_whatever_the_number_of_channels(
        channels: int) -> None:
    assert chi2.sf(gate_of(channels), channels) == pytest.approx(chi2.sf(44.0, 6), rel=1e-9)


@pytest.mark.parametrize('gauges', [2, 20])
def test_no_sample_of_a_clean_arm_is_beyond_the_gate(gauges: int) -> None:
    # With a gate of 44, 144 of 401 samples were with 20 gauges a link.
    robot, command, beyond = robot_of(gauges), np.zeros(2), 0
    estimator = estimator_of(robot)
    simulator = Simulator(ExtendedArm(robot, 'assumed_modes', 2, PAYLOAD), None,
                          Noise(robot.angle_noise, robot.strain_noise), 5)
    for _ in range(401):
        sample = simulator.measure()
        found = estimator.update(sample.time, sample.output, command)
        beyond += estimator.stepper.is_beyond_gate(estimator.incumbent.mean_square)
        command = 4.0 * (square(sample.time) - sample.angle)
        simulator.step(command)
    assert beyond == 0 and found.status == 'ok'
    assert abs(found.mass - PAYLOAD) < 4.0 * found.variance**0.5 < 4e-5


@pytest.mark.parametrize('channels', [6, 42])
def test_innovations_of_twice_their_variance_are_a_poor_fit(channels: int) -> None:
    # Clipped at 44, the mean square of 42 channels was 1.05 at most.
    statistics, ones = initial_statistics(channels), np.ones(channels)
    random = np.random.default_rng(2)
    for _ in range(300):
        innovation = np.sqrt(2.0) * random.standard_normal(channels)
        update_statistics(statistics, innovation, np.zeros(channels), ones, innovation, 0.0,
                          1e-6 * ones, 1.0, gate_of(channels), 0.01)
    assert reduced_chi_square(statistics) > POOR_FIT


def test_a_sample_at_the_gate_is_beyond_it_whatever_the_rounding() -> None:
    # What a filter keeps of it is divided by the number of channels.
    stepper, size = estimator_of(robot_of(20)).stepper, 42
    assert stepper.is_beyond_gate(gate_of(size) / size)
    assert not stepper.is_beyond_gate(0.999 * gate_of(size) / size)
