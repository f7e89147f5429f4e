"""
Show how the default estimator's step time grows, and that a million small steps do no harm.

`python benchmarks/growth.py` prints the processor time of one step over the modes per link (n = 1
… 8) and over the log's length, each with its fitted slope in log-log; one step beside FilterPy's
Kalman filter with 11 states and 6 outputs, in the same run; and the covariance after 10^6 steps
of 1e-4 s. The arm is simulated with the estimator's own model.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
import time

from filterpy.kalman import KalmanFilter
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Noise, Simulator
from matched import GAIN, set_point
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import ArrayLike

# True payload, kg, and end of the estimator's start-up, s.
MASS, SETTLED_S = 0.12, 3.0


class Loop:
    """The estimator beside a simulated arm; each call of `step` is one sample."""

    def __init__(self, robot: Robot, modes: int):
        self.estimator = RecursivePredictionError(robot, 'assumed_modes', modes)
        self.simulator = Simulator(ExtendedArm(robot, 'assumed_modes', modes, MASS),
                                   noise=Noise(robot.angle_noise, robot.strain_noise), seed=1)
        self.command = np.zeros(2)

    def step(self) -> float:
        """Return the processor seconds of the estimator's update."""
        sample = self.simulator.measure()
        begin = time.process_time()
        self.estimate = self.estimator.update(sample.time, sample.output, self.command)
        spent = time.process_time() - begin
        self.command = GAIN * (set_point(sample.time) - sample.angle)
        self.simulator.step(self.command)
        return spent


def filterpy_step() -> float:
    """Return the processor seconds of one predict and update of FilterPy's filter."""
    begin = time.process_time()
    BARE.predict(u=np.ones((2, 1)))
    BARE.update(np.ones((6, 1)))
    return time.process_time() - begin


BARE = KalmanFilter(dim_x=11, dim_z=6, dim_u=2)
BARE.F, BARE.B, BARE.H = 0.9 * np.eye(11), np.ones((11, 2)), np.eye(6, 11)


def slope(x: ArrayLike, y: ArrayLike) -> float:
    """Return the slope of log y over log x."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def over_modes(robot: Robot, samples: int) -> tuple[Array, Array]:
    """Print and return n and the median time of a step after start-up, us."""
    modes, times = np.arange(1.0, 9.0), []
    for n in modes:
        loop = Loop(robot, int(n))
        spent = [loop.step() for _ in range(samples)]
        times.append(1e6 * np.median(spent[round(SETTLED_S / robot.sample_time):]))
        print(f'n = {n:.0f}: {times[-1]:7.0f} us a step', flush=True)
    states = 4.0 * modes + 4.0
    print(f'slope of time over the number of states, 8 … 36: {slope(states, times):.2f}')
    return modes, np.array(times)


def over_length(robot: Robot, modes: int) -> tuple[Array, Array]:
    """Print and return seconds of log and processor seconds for the whole of it."""
    lengths, loop = np.array([10.0, 20.0, 40.0, 80.0, 160.0]), Loop(robot, modes)
    total, times, samples = 0.0, [], 0
    for length in lengths:
        while samples < round(length / robot.sample_time):
            total += loop.step()
            samples += 1
        times.append(total)
        print(f'log of {length:5.0f} s: {total:7.2f} s', flush=True)
    print(f'slope of time over length: {slope(lengths, times):.2f}')
    return lengths, np.array(times)


def one_step(robot: Robot, modes: int, seconds: float) -> None:
    """Print a step's distribution over a whole run, start-up included, beside FilterPy's."""
    loop = Loop(robot, modes)
    spent, bare = np.array([(loop.step(), filterpy_step())
                            for _ in range(round(seconds / robot.sample_time))]).T
    p50, p99 = np.percentile(spent, (50, 99))
    base = np.median(bare)
    print(f'one step, n = {modes}, {seconds:g} s: p50 {1e6 * p50:.0f} us, p99 {1e6 * p99:.0f} us '
          f'({p99 / p50:.1f} p50), FilterPy {1e6 * base:.0f} us, ratio {p50 / base:.2f}')


def many_steps(robot: Robot, modes: int, steps: int) -> None:
    """Print the state of the covariance after many steps of 1e-4 s."""
    loop = Loop(replace(robot, sample_time=1e-4), modes)
    for _ in range(steps):
        loop.step()
    f = loop.estimator.incumbent
    scale = np.sqrt(np.diag(f.cov))
    smallest = np.linalg.eigvalsh(f.cov / np.outer(scale, scale)).min()
    error = (loop.estimate.mass - MASS) / loop.estimate.variance**0.5
    print(f'{steps} steps of 1e-4 s: symmetric {np.array_equal(f.cov, f.cov.T)}, smallest '
          f'eigenvalue of the correlation {smallest:.1e}, variance {loop.estimate.variance:.2e} '
          f'kg^2, error {error:+.2f} standard deviations, status {loop.estimate.status}')


def draw(by_modes: tuple[Array, Array], by_length: tuple[Array, Array], path: Path) -> None:
    """Plot the time of a step over the modes and of a log over its length."""
    figure = Figure(figsize=(9, 3.6), layout='constrained')
    left, right = figure.subplots(1, 2)
    left.plot(*by_modes, 'o-')
    left.set(xlabel='modes a link, n', ylabel='one step, µs', ylim=(0, None))
    right.plot(*by_length, 'o-')
    right.set(xlabel='length of the log, s', ylabel='processor time, s', ylim=(0, None))
    for axis in (left, right):
        axis.grid(alpha=0.3)
    figure.savefig(path, dpi=150)


def main() -> None:
    """Print and draw if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--samples', type=int, default=800, help='per number of modes')
    parser.add_argument('--steps', type=int, default=1_000_000, help='of 1e-4 s; 0 for none')
    parser.add_argument('--figure', type=Path, metavar='PNG', help='where to draw it')
    options = parser.parse_args()
    robot = load_robot('reference')
    by_modes = over_modes(robot, options.samples)
    by_length = over_length(robot, 3)
    for n in (2, 3):
        one_step(robot, n, 120.0)
    if options.figure:
        draw(by_modes, by_length, options.figure)
    if options.steps:
        many_steps(robot, 2, options.steps)


if __name__ == '__main__':
    main()
