"""The recursive-prediction-error estimator beside a simulated arm, for its tests."""

from __future__ import annotations

from dataclasses import replace

from flex_payload_estimator.estimators.base import Estimate
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_payload_estimator.estimators.rpe.settings import RpeSettings
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.payload_profile import PayloadProfile
from flex_plant_sim.simulation.simulator import Noise, Simulator
import numpy as np

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
                 moving: float = np.inf, noise: Noise | None = None):
        robot = estimator.arm.robot
        noise = noise or Noise(robot.angle_noise, robot.strain_noise,
                               estimator.settings.torque_noise[0])
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
