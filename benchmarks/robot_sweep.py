"""
Run every estimator on very different robots and rates, and count what goes wrong.

`python benchmarks/robot_sweep.py` takes light, heavy, stiff, undamped and plain arms, steps from
1e-5 to 0.1 s and payloads from 0 to 100 kg. Each arm is simulated by the estimator's own model:
first at rest, noise only, then moving. Counted are exceptions, answers that are not finite, 'ok'
at rest, and a variance at the end of the rest below that at its begin.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import replace
import itertools

from flex_payload_estimator.estimators.factory import make_estimator
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Noise, Simulator
from msg_config.errors import InputError
import numpy as np

MODELS = {'sf1_paper': 'paper_reduced', 'sf1': 'paper_reduced', 'rpe': 'assumed_modes'}
# Factors of each link's parameters, by kind of arm.
KINDS = {'plain': {}, 'light': {'density': 0.1}, 'heavy': {'density': 10.0},
         'stiff': {'youngs_modulus': 100.0}, 'undamped': {'damping_ratio': 0.0},
         'light and soft': {'density': 0.1, 'youngs_modulus': 0.1}}
STEPS = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
PAYLOADS = (0.0, 1e-3, 0.01, 0.1, 0.3, 1.0, 10.0, 100.0)
# Modes per link, largest command, and samples at rest before the arm moves.
MODES, RATE, STILL = 2, 0.5, 40


def robot_of(kind: str, step: float, payload: float) -> Robot:
    """Return the robot of a kind, with a sampling time, s, and payload, kg."""
    robot = replace(load_robot('reference'), sample_time=step, payload_mass=payload)
    for j, link in enumerate(robot.links):
        changes = {key: factor * getattr(link, key) for key, factor in KINDS[kind].items()}
        robot = robot.with_link(j, **changes)
    return robot


def faults(name: str, robot: Robot, samples: int, seed: int) -> list[str]:
    """Return what went wrong with an estimator: at rest first, then under commands."""
    try:
        arm = ExtendedArm(robot, MODELS[name], MODES)
        simulator = Simulator(arm, None, Noise(robot.angle_noise, robot.strain_noise), seed)
        estimator = make_estimator(name, robot, MODELS[name], MODES)
    except InputError as error:
        return [f'refused: {error}']
    random, command, found, rest = np.random.default_rng(seed), np.zeros(2), [], []
    try:
        with np.errstate(invalid='raise', divide='raise', over='raise'):
            for k in range(samples):
                sample = simulator.measure()
                answer = estimator.update(sample.time, sample.output, command)
                if not np.isfinite([answer.mass, answer.variance, *answer.innovation]).all():
                    found.append('not finite')
                if k < STILL:
                    rest.append(answer.variance)
                    if answer.status == 'ok':
                        found.append('ok at rest')
                if k >= STILL and k % 10 == 0:
                    command = RATE * random.uniform(-1.0, 1.0, 2)
                simulator.step(command)
    except (ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        return [*found, f'{type(error).__name__}: {error}']
    if rest[-1] < rest[0] * (1.0 - 1e-9):
        found.append(f'surer at rest: {rest[-1]**0.5:.3g} after {rest[0]**0.5:.3g} kg')
    return found


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--runs', type=int, default=0, help='robots, drawn; 0 for all 240')
    parser.add_argument('--samples', type=int, default=80)
    parser.add_argument('--seed', type=int, default=0, help='of the drawn robots, and first noise')
    parser.add_argument('--estimators', nargs='*', default=tuple(MODELS))
    options = parser.parse_args()
    cases = list(itertools.product(KINDS, STEPS, PAYLOADS))
    if options.runs:
        random = np.random.default_rng(options.seed)
        cases = [cases[k] for k in random.choice(len(cases), options.runs, replace=False)]
    for name in options.estimators:
        count: Counter[str] = Counter()
        for seed, (kind, step, payload) in enumerate(cases, options.seed):
            found = sorted(set(faults(name, robot_of(kind, step, payload), options.samples, seed)))
            count.update(fault.split(':')[0] for fault in found)
            for fault in found:
                print(f'  {name}, {kind}, T = {step:g} s, {payload:g} kg: {fault}', flush=True)
        print(f'{name}: {len(cases)} robots, {dict(count) or "nothing wrong"}', flush=True)


if __name__ == '__main__':
    main()
