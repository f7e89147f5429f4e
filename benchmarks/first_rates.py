"""
Count arms at rest that are taken for moving at their first row, and stretches in motion for rest.

`python benchmarks/first_rates.py` makes finite-element arms of `test/truth` with each effect in
turn, which begin at rest, most of them under a steep command. It prints the largest ratio of a
rate to its deviation there, and how many stretches of the same records that move at 0.4 rad/s and
more are below `first_rates.MOVES`.
"""

from __future__ import annotations

import argparse

import _truths  # noqa: F401
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.inputs.first_rates import first_rates, MOVES
import numpy as np
from truth.records import CATALOGUE, draw_case, make_record

# Rows of a sixth of each robot's slowest period; rate from which a stretch is in motion, rad/s.
ROWS = {'reference': 14, 'quanser_2dsfl': 34}
MOVING, STRETCHES = 0.4, 10


def ratio(joint: Array, step: float, noise: float) -> float:
    """Return the larger ratio of a rate at the first row to its deviation."""
    rates, deviations = first_rates(joint, step, np.full(2, noise))
    return float(np.max(np.abs(rates) / deviations))


def main() -> None:
    """Print both counts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--seed', type=int, default=94000)
    parser.add_argument('--seconds', type=float, default=6.0, help='length of a record')
    chosen = parser.parse_args()
    rest, motion = [], []
    for name, rows in ROWS.items():
        robot, random = load_robot(name), np.random.default_rng(chosen.seed)
        for k, effect in enumerate([None, *CATALOGUE]):
            case = draw_case(effect, chosen.seed + k, name, duration_s=chosen.seconds)
            try:
                made = make_record(case)
            except ValueError:  # a form that only MuJoCo's arm has
                continue
            step = float(made.time[1] - made.time[0])
            rest.append(ratio(made.joint[:rows], step, robot.angle_noise))
            for first in random.integers(rows, len(made.joint) - rows, STRETCHES):
                around = made.joint[first - rows // 2:first + rows // 2 + 1]
                if np.max(np.abs(around[-1] - around[0])) > MOVING * step * (len(around) - 1):
                    motion.append(ratio(made.joint[first:first + rows], step, robot.angle_noise))
    print(f'{len(rest)} arms at rest: ratio at most {max(rest):.1f}')
    print(f'{len(motion)} stretches in motion: {np.sum(np.array(motion) < MOVES)} below {MOVES:g}')


if __name__ == '__main__':
    main()
