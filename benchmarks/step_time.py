"""
Print each estimator's whole step beside FilterPy's bare Kalman filter, with and without Numba.

`python benchmarks/step_time.py` times the estimator's update (Kalman predictor and regression) and
the controller's LQ gain, n = 2, n' = 15, against a predict and update of FilterPy's filter with 11
states, 6 outputs and 2 inputs; all in turn in one process, once for Numba and once without. Then
the parts of the step of `sf1`, and how much faster than real time the whole loop runs.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
import json
import math
import os
import subprocess
import sys
import time

from filterpy.kalman import KalmanFilter
from flex_payload_estimator.control.loop import run_loop
from flex_payload_estimator.control.lqg import LQGController, LQGSettings
from flex_payload_estimator.control.set_points import square
from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.estimators.sf1.estimator import SF1Estimator
from flex_payload_estimator.kalman.riccati import riccati_step
from flex_payload_estimator.model.delta import halvings_for, omega, TERMS
from flex_payload_estimator.model.payload_model import payload_model
from flex_payload_estimator.model.split import rates_at
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.compiled import COMPILED
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Noise, Simulator
import numpy as np

STEP = 0.01
MODELS = {'sf1': 'paper_reduced', 'rpe': 'assumed_modes'}
SETTINGS = LQGSettings(integrator=False, command_limit=math.inf)
# Samples of an estimator's start-up, which are not timed.
SETTLED = 600
Steps = dict[str, Callable[[], object]]


def filterpy_step() -> Callable[[], None]:
    """Return a predict and update of FilterPy's filter: 11 states, 6 outputs, 2 inputs."""
    bare = KalmanFilter(dim_x=11, dim_z=6, dim_u=2)
    bare.F, bare.B, bare.H = 0.9 * np.eye(11), np.ones((11, 2)), np.eye(6, 11)
    output, command = np.ones((6, 1)), np.ones((2, 1))

    def step() -> None:
        bare.predict(u=command)
        bare.update(output)

    return step


def lq_step(modes: int) -> Callable[[], object]:
    """Return the controller's Riccati iteration."""
    robot = load_robot('reference')
    model = payload_model(robot, 'paper_reduced', modes)
    controller = LQGController(robot, 'paper_reduced', modes, SETTINGS)
    a, b = model.matrices(math.cos(0.5), 0.1)
    big = omega(a, STEP, TERMS, halvings_for(model.radius, STEP, TERMS))
    a_bar, b_bar = big @ a, big @ b
    return lambda: riccati_step(a_bar, b_bar, controller.q_1, controller.q_2, controller.cost,
                                STEP)


def running(name: str, modes: int) -> Callable[[], object]:
    """Return one step of an estimator beside an arm in motion, and of the LQ gain."""
    robot = load_robot('reference')
    estimator = make_estimator(name, robot, MODELS[name], modes)
    simulator = Simulator(ExtendedArm(robot, MODELS[name], modes, 0.1), None,
                          Noise(robot.angle_noise, robot.strain_noise), seed=1)
    command, rows = np.zeros(2), []
    for k in range(4 * SETTLED):
        sample = simulator.measure()
        rows.append((sample.time, sample.output, command))
        command = 4.0 * ((0.5 if k % 400 < 200 else -0.5) - sample.angle)
        simulator.step(command)
    for row in rows[:SETTLED]:
        estimator.update(*row)
    gain, remaining = lq_step(modes), iter(rows[SETTLED:])

    def step() -> None:
        estimator.update(*next(remaining))
        gain()

    return step


def part_steps(name: str, modes: int) -> Steps:
    """Return parts of one step: the model, all of the update, the LQ gain."""
    robot = load_robot('reference')
    estimator, model = SF1Estimator(robot, name, modes), payload_model(robot, name, modes)
    x, u, cosine = 1e-2 * np.ones(model.states), np.array([0.1, 0.2]), math.cos(0.5)
    output, command = np.full(len(model.scale), 1e-3), np.zeros(2)
    for _ in range(2):
        estimator.update(0.0, output, command)
    return {'filterpy': filterpy_step(),
            'model': lambda: rates_at(cosine, model.tables, 0.1, 0.11, x, u, False),
            'update': lambda: estimator.update(0.0, output, command),
            'lq_gain': lq_step(modes)}


def interleaved(steps: Steps, rounds: int) -> dict[str, list[float]]:
    """Return processor microseconds of each call; all are called in every round."""
    found: dict[str, list[float]] = {name: [] for name in steps}
    for step in steps.values():
        step()
    for _ in range(rounds):
        for name, step in steps.items():
            start = time.thread_time_ns()
            step()
            found[name].append((time.thread_time_ns() - start) * 1e-3)
    return found


def loop_speed(modes: int, seconds: float) -> float:
    """Return simulated seconds per processor second of the whole loop."""
    robot = load_robot('reference')
    simulator = Simulator(ExtendedArm(robot, 'paper_reduced', modes, 0.1), None,
                          Noise(2e-4, 5e-7))
    estimator = make_estimator('sf1', robot, 'paper_reduced', modes)
    controller = LQGController(robot, 'paper_reduced', modes, SETTINGS)
    run_loop(simulator, estimator, controller, square(), 0.2)
    simulator.reset()
    start = time.process_time()
    run_loop(simulator, estimator, controller, square(), seconds)
    return seconds / (time.process_time() - start)


def measure(modes: int, rounds: int) -> dict[str, dict[str, list[float]]]:
    """Return all times of this process."""
    whole = {'FilterPy': filterpy_step(), **{name: running(name, modes) for name in MODELS}}
    return {'steps': interleaved(whole, min(rounds, 3 * SETTLED - 2)),
            'parts': interleaved(part_steps('paper_reduced', modes), rounds),
            'loop': {'speed': [loop_speed(modes, 8.0)]}}


def elsewhere(arguments: argparse.Namespace, jit: bool) -> dict[str, dict[str, list[float]]]:
    """Return the times of a fresh process with or without Numba."""
    environment = {**os.environ, 'NUMBA_DISABLE_JIT': str(int(not jit)),
                   'OPENBLAS_NUM_THREADS': '1'}
    answer = subprocess.run(
        [sys.executable, __file__, '--here', '--modes', str(arguments.modes), '--rounds',
         str(arguments.rounds)], env=environment, capture_output=True, text=True, check=True)
    found: dict[str, dict[str, list[float]]] = json.loads(answer.stdout)
    return found


def table(times: dict[str, list[float]], base: str) -> None:
    """Print one row per step."""
    print(f'{"":14s}{"p50 us":>9s}{"p99 us":>9s}{"p99 / p50":>11s}{"/ FilterPy":>12s}')
    for name, values in times.items():
        middle, slow = np.percentile(values, (50, 99))
        print(f'{name:14s}{middle:9.1f}{slow:9.1f}{slow / middle:11.2f}'
              f'{middle / np.median(times[base]):12.2f}')


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--modes', type=int, default=2)
    parser.add_argument('--rounds', type=int, default=1500)
    parser.add_argument('--here', action='store_true', help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.here:
        json.dump(measure(arguments.modes, arguments.rounds), sys.stdout)
        return
    for jit in ((False, True) if COMPILED else (False,)):
        found = elsewhere(arguments, jit)
        print(f'{"with" if jit else "without"} Numba, n = {arguments.modes}: update and LQ gain')
        table(found['steps'], 'FilterPy')
        print('parts of sf1')
        table(found['parts'], 'filterpy')
        print(f'whole loop: {found["loop"]["speed"][0]:.1f} times real time\n')


if __name__ == '__main__':
    main()
