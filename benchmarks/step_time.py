"""Print the offline loop's speed and each part's time a step, beside FilterPy's."""

from __future__ import annotations

import argparse
from collections.abc import Callable
import math
import time

from filterpy.kalman import KalmanFilter
from flex_payload_estimator.delta import DeltaOperator
from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.estimators.sf1 import SF1Estimator
from flex_payload_estimator.loop import run_loop
from flex_payload_estimator.lqg import LQGController
from flex_payload_estimator.payload_model import payload_model
from flex_payload_estimator.riccati import riccati_step
from flex_payload_estimator.set_points import square
from flex_plant_sim.extended_arm import ExtendedArm
from flex_plant_sim.robot import load_robot
from flex_plant_sim.simulation import Noise, Simulator
import numpy as np

STEP = 0.01
PARTS = ('model', 'omega', 'kalman', 'regression', 'lq_gain')


def filterpy_step() -> Callable[[], None]:
    """Return a predict and update of FilterPy's filter: 11 states, 6 outputs, 2 inputs."""
    bare = KalmanFilter(dim_x=11, dim_z=6, dim_u=2)
    bare.F, bare.B, bare.H = 0.9 * np.eye(11), np.ones((11, 2)), np.eye(6, 11)
    output, command = np.ones((6, 1)), np.ones((2, 1))

    def step() -> None:
        bare.predict(u=command)
        bare.update(output)

    return step


def part_steps(name: str, modes: int) -> dict[str, Callable[[], object]]:
    """Return each part of one step: Kalman gain, regression and LQ gain of one model."""
    robot = load_robot('reference')
    estimator = SF1Estimator(robot, name, modes)
    model, controller = payload_model(robot, name, modes), LQGController(robot, name, modes)
    x, u, cosine = 1e-2 * np.ones(model.states), np.array([0.1, 0.2]), math.cos(0.5)
    operator = DeltaOperator(model.states, STEP, 15, model.halvings)
    a, rates = model.rates(cosine, 0.1, x, u, 'resolvent')
    big = operator(a)
    a_bar, b_bar = big @ a, big @ model.matrices(cosine, 0.1)[1]
    output, command = np.full(len(model.scale), 1e-3), np.zeros(2)
    estimator.update(0.0, output, command)

    def regress() -> object:
        return estimator.regress(0.0, output, estimator.prediction_of(x, big, rates))

    parts: dict[str, Callable[[], object]] = {
        'filterpy': filterpy_step(),
        'model': lambda: model.rates(cosine, 0.1, x, u, 'resolvent'),
        'omega': lambda: operator(a),
        'kalman': lambda: estimator.kalman.update(a_bar),
        'regression': regress,
        'lq_gain': lambda: riccati_step(a_bar, b_bar, controller.q_1, controller.q_2,
                                        controller.cost, STEP)}
    own = [parts[name] for name in PARTS]
    return {
        **parts,
        'one step': lambda: [part() for part in own],
        'estimator.update': lambda: estimator.update(0.0, output, command),
        'controller.command': lambda: controller.command(0.0, output, command, 0.1, command),
    }


def interleaved(steps: dict[str, Callable[[], object]], rounds: int,
                calls: int = 5) -> dict[str, np.ndarray]:
    """Return processor microseconds a call, one number a round; all are timed in every round."""
    found: dict[str, list[float]] = {name: [] for name in steps}
    for _ in range(rounds):
        for name, step in steps.items():
            start = time.process_time()
            for _ in range(calls):
                step()
            found[name].append((time.process_time() - start) / calls * 1e6)
    return {name: np.array(values) for name, values in found.items()}


def loop_speed(modes: int, seconds: float) -> float:
    """Return simulated seconds a processor second of the whole loop."""
    robot = load_robot('reference')
    simulator = Simulator(ExtendedArm(robot, 'paper_reduced', modes, 0.1), None,
                          Noise(2e-4, 5e-7))
    estimator = make_estimator('sf1', robot, 'paper_reduced', modes)
    controller = LQGController(robot, 'paper_reduced', modes)
    run_loop(simulator, estimator, controller, square(), 0.2)
    simulator.reset()
    start = time.process_time()
    run_loop(simulator, estimator, controller, square(), seconds)
    return seconds / (time.process_time() - start)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--modes', type=int, default=2)
    parser.add_argument('--model', default='paper_reduced')
    parser.add_argument('--rounds', type=int, default=400)
    arguments = parser.parse_args()
    speed = loop_speed(arguments.modes, 8.0)
    print(f'loop, n = {arguments.modes}, T = {STEP:g} s: {speed:.1f} times real time')
    times = interleaved(part_steps(arguments.model, arguments.modes), arguments.rounds)
    base = np.median(times['filterpy'])
    print(f'{"part":20s}{"p50 us":>9s}{"p99 us":>9s}{"/ FilterPy":>12s}')
    for name, values in times.items():
        print(f'{name:20s}{np.median(values):9.1f}{np.percentile(values, 99):9.1f}'
              f'{np.median(values) / base:12.2f}')


if __name__ == '__main__':
    main()
