"""Estimators that predict ahead of the sample give the same bits."""

from __future__ import annotations

from flex_payload_estimator.estimators.base import Estimate
from flex_payload_estimator.estimators.factory import make_estimator
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Noise, Simulator
import numpy as np
import pytest

ROBOT = load_robot('reference')
CASES = {'sf1_paper': ('paper_reduced', 2), 'sf1': ('assumed_modes', 2),
         'rpe': ('assumed_modes', 2)}


def answers(name: str, told: str, samples: int = 120) -> list[Estimate]:
    """Return the estimates when the command is told ahead: 'not', 'right' or 'wrong'."""
    model, modes = CASES[name]
    estimator = make_estimator(name, ROBOT, model, modes)
    simulator = Simulator(ExtendedArm(ROBOT, 'paper_reduced', 2, 0.1), None, Noise(2e-4, 5e-7))
    found, command = [], np.zeros(2)
    for k in range(samples):
        output = simulator.measure().output
        if k == 60:
            output[3] = np.nan
        found.append(estimator.update(simulator.time, output, command))
        command = np.array([0.5, -0.8]) if (k // 30) % 2 else np.array([-0.6, 0.9])
        if told != 'not':
            estimator.prepare(command if told == 'right' else command + 0.3)
        simulator.step(command)
    return found


@pytest.mark.parametrize('name', CASES)
@pytest.mark.parametrize('told', ['right', 'wrong'])
def test_predicting_ahead_changes_no_bit(name: str, told: str) -> None:
    for one, other in zip(answers(name, 'not'), answers(name, told)):
        assert (one.mass, one.variance, one.p, one.status) == (
            other.mass, other.variance, other.p, other.status)
        np.testing.assert_array_equal(one.innovation, other.innovation)
        np.testing.assert_array_equal(one.innovation_std, other.innovation_std)
