"""
The experiment of the matched-model studies, where the simulated arm is the estimator's model.

A P controller on the measured joint angles, u = 4 (w - theta) in rad/s, follows square
set-points of +-0.5 rad and 4 s on both joints, so that the arm moves from the first sample on.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
import multiprocessing
from multiprocessing.pool import Pool

import _truths  # noqa: F401
from cramer_rao import linearise, payload_bound
from flex_payload_estimator.estimators.rpe.sensors import start_spread
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.interval import Z95
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Noise, Simulator
import numpy as np

# Square set-points, rad and s, and gain of the P controller, 1/s.
AMPLITUDE, PERIOD_S, GAIN = 0.5, 4.0, 4.0
# Payloads that cases are drawn from, kg.
LIGHTEST, HEAVIEST = 0.03, 0.3
# Noise that cases are drawn from, rad on angles and V on gauges.
SMALLEST_NOISE, LARGEST_NOISE = 1e-4, 1e-2
# Process noise: torque on each joint, N m.
TORQUE_NOISE = 0.05


@dataclass(frozen=True)
class Record:
    """
    A simulated run without an estimator.

    Attributes
    ----------
    time : Array
        s, (N,).
    states, outputs, commands : Array
        (N, n), (N, m) and (N, 2); command k is applied from time k on.
    mass : float
        Payload, kg.

    """

    time: Array
    states: Array
    outputs: Array
    commands: Array
    mass: float


@dataclass(frozen=True)
class Case:
    """A drawn case: payload, kg, noise (rad, V on gauges), torque noise, N m, seed, step, s."""

    mass: float
    noise: float
    torque: float
    seed: int
    step: float = 0.01

    @classmethod
    def draw(cls, seed: int, torque: float, step: float = 0.01) -> Case:
        """Draw a payload uniformly, a noise level uniformly in its logarithm."""
        random = np.random.default_rng([seed, 1])
        low, high = np.log(SMALLEST_NOISE), np.log(LARGEST_NOISE)
        return cls(random.uniform(LIGHTEST, HEAVIEST), float(np.exp(random.uniform(low, high))),
                   torque, seed, step)

    def robot(self) -> Robot:
        """Return the reference robot with this noise."""
        robot = load_robot('reference')
        return replace(robot, sample_time=self.step, angle_noise=self.noise,
                       strain_noise=self.noise / robot.gauge_amplifier)


def set_point(time: float) -> float:
    """Return the square set-point of both joints, rad."""
    return AMPLITUDE if (time + 1e-9) % PERIOD_S < PERIOD_S / 2 else -AMPLITUDE


def record(arm: ExtendedArm, case: Case, seconds: float) -> Record:
    """Simulate a case in closed loop."""
    robot = case.robot()
    noise = Noise(robot.angle_noise, robot.strain_noise, case.torque)
    simulator = Simulator(arm.at_payload(case.mass), None, noise, case.seed)
    rows = []
    for _ in range(round(seconds / robot.sample_time) + 1):
        sample = simulator.measure()
        command = GAIN * (set_point(sample.time) - sample.angle)
        rows.append((sample.time, simulator.state.copy(), sample.output, command))
        simulator.step(command)
    time, states, outputs, commands = (np.array(column) for column in zip(*rows))
    return Record(time, states, outputs, commands, case.mass)


def bound(arm: ExtendedArm, case: Case, run: Record) -> Array:
    """Return the Cramer-Rao bound of the payload's standard deviation, kg, at each sample."""
    robot = case.robot()
    model = linearise(arm.at_payload(case.mass), run.states[:-1], run.commands[:-1])
    noise = [robot.angle_noise] * 2 + [robot.strain_noise] * (run.outputs.shape[1] - 2)
    return payload_bound(model, noise, start_spread(arm), [case.torque] * 2)


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Return the 95 % interval of a share, hits of count (Wilson 1927)."""
    z, share = Z95, hits / count
    centre = (share + z * z / (2 * count)) / (1 + z * z / count)
    half = z / (1 + z * z / count) * np.sqrt(share * (1 - share) / count + (z / count)**2 / 4)
    return centre - half, centre + half


def coverage(error: Array, std: Array) -> str:
    """Return how many 95 % intervals hold the error, and the interval of that share, in %."""
    inside = int(np.sum(np.abs(error) < Z95 * std))
    low, high = wilson(inside, len(error))
    return f'{100 * inside / len(error):8.1f}%{100 * low:8.1f} -{100 * high:5.1f}%'


@contextmanager
def workers(jobs: int) -> Iterator[Pool]:
    """Yield a pool of processes, each started afresh."""
    with multiprocessing.get_context('spawn').Pool(jobs) as pool:
        yield pool
