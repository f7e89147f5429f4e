"""
Compare SF1's stated variance with its errors, on matched models.

`python benchmarks/sf1_variance.py --runs 500` draws payloads of 0.03-0.3 kg, with `--prior` from
the prior that `sf1` states, and noise of 1e-4-1e-2 (rad, and V on the gauges) and prints, at 1, 3,
5 and 10 s, the root mean square of error over stated standard deviation, the share inside the 95 %
interval and the median error; then, at other sampling intervals, each sample with the same noise,
root mean square error and mean stated standard deviation over `--repeats` noise seeds.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import lru_cache

from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.estimators.sf1.settings import SF1Settings
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.interval import Z95
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Noise, Simulator
from matched import Case, GAIN, record, set_point
import numpy as np

TIMES_S = (1.0, 3.0, 5.0, 10.0)
STEPS_S = (1e-2, 1e-3, 1e-4)


@lru_cache(maxsize=4)
def arm_of(model: str, step: float) -> ExtendedArm:
    """Return the reference arm with two modes, built once."""
    return ExtendedArm(replace(load_robot('reference'), sample_time=step), model, 2)


def run(name: str, model: str, seed: int, prior: bool) -> Array:
    """Return error and stated standard deviation, kg, at TIMES_S, (2, 4)."""
    case = Case.draw(seed, 0.0)
    if prior:
        given, random = SF1Settings(), np.random.default_rng([seed, 2])
        mass = abs(random.normal(given.mass_0, given.variance_0**0.5))
        case = replace(case, mass=float(mass))
    data = record(arm_of(model, 0.01), case, TIMES_S[-1])
    estimator = make_estimator(name, case.robot(), model, 2)
    command, estimates = np.zeros(2), []
    for time, output, after in zip(data.time, data.outputs, data.commands):
        estimates.append(estimator.update(time, output, command))
        command = after
    return np.array([(estimates[k].mass - case.mass, estimates[k].variance**0.5)
                     for k in (round(time / 0.01) for time in TIMES_S)]).T


def at_step(model: str, step: float, noise: float, seed: int, until: float) -> Array:
    """Return errors and standard deviations, kg, (2, times); commands change every 10 ms."""
    arm = arm_of(model, step).at_payload(0.12)
    robot = replace(arm.robot, angle_noise=noise, strain_noise=noise / arm.robot.gauge_amplifier)
    simulator = Simulator(arm, None, Noise(robot.angle_noise, robot.strain_noise), seed)
    estimator, command, found = make_estimator('sf1', robot, model, 2), np.zeros(2), []
    every = max(1, round(0.01 / step))
    for k in range(round(until / step) + 1):
        sample = simulator.measure()
        found.append(estimator.update(sample.time, sample.output, command))
        if k % every == 0:
            command = GAIN * (set_point(sample.time) - simulator.state[:2])
        simulator.step(command)
    at = [found[round(time / step)] for time in TIMES_S if time <= until]
    return np.array([[e.mass - 0.12 for e in at], [e.variance**0.5 for e in at]])


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--runs', type=int, default=500)
    parser.add_argument('--seed', type=int, default=0, help='first')
    parser.add_argument('--prior', action='store_true', help="payloads from sf1's prior")
    parser.add_argument('--estimators', nargs='+', default=['sf1'])
    parser.add_argument('--models', nargs='+', default=['paper_reduced', 'assumed_modes'])
    parser.add_argument('--steps', type=float, nargs='*', default=STEPS_S)
    parser.add_argument('--repeats', type=int, default=1, help='noise seeds of each step')
    parser.add_argument('--until', type=float, default=TIMES_S[-1], help='of these, s')
    given = parser.parse_args()
    for model in given.models:
        for name in given.estimators if given.runs else ():
            seeds = range(given.seed, given.seed + given.runs)
            found = np.array([run(name, model, seed, given.prior) for seed in seeds])
            ratio = found[:, 0] / found[:, 1]
            print(f'{name}, {model}, {given.runs} runs')
            for k, time in enumerate(TIMES_S):
                inside = np.mean(np.abs(ratio[:, k]) < Z95)
                error = 1e3 * np.median(np.abs(found[:, 0, k]))
                print(f'{time:5g} s: RMS z {np.sqrt(np.mean(ratio[:, k]**2)):6.2f}, in 95 % '
                      f'{100 * inside:5.1f} %, median error {error:8.3f} g', flush=True)
        for step in given.steps:
            errors, stds = np.moveaxis(np.array([
                at_step(model, step, 1e-3, seed, given.until)
                for seed in range(given.seed, given.seed + given.repeats)]), 1, 0)
            print(f'T = {step:g} s, {model}, {given.repeats} runs, at {TIMES_S[:stds.shape[1]]} s:'
                  ' RMS error, g', (1e3 * np.sqrt(np.mean(errors**2, axis=0))).round(3),
                  'stated', (1e3 * stds.mean(axis=0)).round(3), flush=True)


if __name__ == '__main__':
    main()
