"""
Count how often the default estimator's 95 % interval holds the payload of arms with drawn parts.

`python benchmarks/interval_coverage.py` draws arms of the model's own form, whose parts and gauges
deviate by the robot file's tolerances, and random cases as in accuracy.py, with other seeds.
"""

from __future__ import annotations

import argparse
from functools import partial

from flex_payload_estimator.estimators.factory import make_estimator
from flex_plant_sim.arm.parts import drawn
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from matched import Case, coverage, record, workers
import numpy as np

TIMES_S = (1.0, 3.0, 10.0)
FIRST_SEED = 100_000


def run(seed: int, modes: int) -> Array:
    """Return error and stated standard deviation over the payload at TIMES_S, (2, 3)."""
    case = Case.draw(FIRST_SEED + seed, 0.0)
    arm = ExtendedArm(drawn(load_robot('reference'), np.random.default_rng([seed, 2])),
                      'assumed_modes', modes)
    data = record(arm, case, TIMES_S[-1])
    gains = np.ones(data.outputs.shape[1])
    spread = arm.robot.tolerances.strain_gain
    gains[2:] += spread * np.random.default_rng([seed, 3]).standard_normal(gains.size - 2)
    estimator = make_estimator('rpe', case.robot(), 'assumed_modes', modes,
                               torque_noise=(0.0, 0.0))
    command, found = np.zeros(2), []
    for time, output, after in zip(data.time, data.outputs, data.commands):
        estimate = estimator.update(time, gains * output, command)
        command = after
        if np.min(np.abs(time - np.array(TIMES_S))) < 1e-6:
            found.append(((estimate.mass - case.mass) / case.mass,
                          estimate.variance**0.5 / case.mass))
    return np.array(found).T


def report(found: Array) -> None:
    """Print the coverage; found is (runs, 2, times)."""
    for k, time in enumerate(TIMES_S):
        print(f'{time:5g}{len(found):6d}{coverage(found[:, 0, k], found[:, 1, k])}'
              f'{100 * np.sqrt(np.mean(found[:, 0, k]**2)):12.4f}'
              f'{100 * np.median(found[:, 1, k]):14.4f}', flush=True)


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--runs', type=int, default=300)
    parser.add_argument('--modes', type=int, default=3)
    parser.add_argument('--jobs', type=int, default=2)
    parser.add_argument('--seed', type=int, default=0, help='first')
    options = parser.parse_args()
    print(f'{"at s":>5s}{"runs":>6s}{"in 95 %":>9s}{"its interval":>15s}'
          f'{"RMSE %":>13s}{"median std %":>14s}')
    seeds = range(options.seed, options.seed + options.runs)
    with workers(options.jobs) as pool:
        report(np.array(pool.map(partial(run, modes=options.modes), seeds, chunksize=5)))


if __name__ == '__main__':
    main()
