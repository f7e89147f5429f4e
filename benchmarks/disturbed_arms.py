"""
Estimate the payload of disturbed arms: gauge biases, drift, noise, a burst, parts far off.

The arms are clean ones of two other simulators (finite elements and a MuJoCo chain, parts drawn
from their tolerances), so that none is rpe's model; each is disturbed in each way. Printed, for
each disturbance and time: the coverage of the 95 % interval, root mean square and worst of the
errors and the half width, in % of the payload. Nothing is tuned on it; seeds from 7000 on.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace

import _truths  # noqa: F401
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.interval import Z95
from model_error import rows_of
import numpy as np
from truth.records import draw_case, make_record, Record, TruthCase

TRUTHS = ('finite_elements', 'mujoco')
TIMES_S = (1.0, 3.0, 6.0, 10.0)
# Bias of each gauge, m/m, and the time, s, in which its drift grows to that; noise and burst as
# multiples of the robot file's noise; begin and end of the burst, s; relative error of the lower
# link's stiffness and of the first drive's inertia.
BIAS, DRIFT_S, NOISE, BURST, BURST_S, OFF = 2e-5, 10.0, 10.0, 50.0, (3.0, 3.5), 0.02
Spoil = Callable[[Record, np.random.Generator], Record]


def biased(record: Record, random: np.random.Generator) -> Record:
    """Return the record with a bias of either sign on each gauge."""
    return replace(record, strain=record.strain + BIAS * random.choice((-1.0, 1.0), 4))


def drifting(record: Record, random: np.random.Generator) -> Record:
    """Return the record with a bias of either sign on each gauge that grows from nothing."""
    grown = BIAS * (record.time / DRIFT_S)[:, None]
    return replace(record, strain=record.strain + grown * random.choice((-1.0, 1.0), 4))


def noisy(record: Record, random: np.random.Generator, factor: float = NOISE,
          when: tuple[float, float] = (0.0, np.inf)) -> Record:
    """Return the record with `factor` times the robot file's noise added during `when`, s."""
    robot, on = load_robot('reference'), (record.time >= when[0]) & (record.time < when[1])
    joint, strain = (factor * size * on[:, None] * random.standard_normal(values.shape)
                     for size, values in ((robot.angle_noise, record.joint),
                                          (robot.strain_noise, record.strain)))
    return replace(record, joint=record.joint + joint, strain=record.strain + strain)


def spoils() -> dict[str, Spoil]:
    """Return the disturbances of a record, by name."""
    return {'clean': lambda record, _: record, 'gauge bias 2e-5': biased,
            'gauge drift 2e-5 in 10 s': drifting, 'noise x 10': noisy,
            'burst x 50, 3 to 3.5 s': lambda record, random: noisy(record, random, BURST, BURST_S)}


def answers(estimator: RecursivePredictionError, record: Record, case: TruthCase) -> Array:
    """Return relative errors and standard deviations at TIMES_S, (times, 2)."""
    estimator.reset()
    found = [estimator.update(*row) for row in rows_of(record)]
    return np.array([(a.mass - case.payload_true, a.variance**0.5) for a in found
                     if np.isclose(a.time, TIMES_S).any()]) / case.payload_true


def report(name: str, found: Array) -> None:
    """Print a line of (runs, times, 2)."""
    error, deviation = 100.0 * np.moveaxis(found, -1, 0)
    inside = np.abs(error) < Z95 * deviation
    print(f'{name:24s}' + ''.join(
        f' |{inside[:, k].sum():3d}/{len(found):<3d}{np.sqrt(np.mean(error[:, k]**2)):6.1f}'
        f'{np.abs(error[:, k]).max():6.1f}{Z95 * deviation[:, k].mean():6.1f}'
        for k in range(len(TIMES_S))), flush=True)


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--runs', type=int, default=6, help='of each simulator')
    parser.add_argument('--seed', type=int, default=7000, help='first')
    parser.add_argument('--modes', type=int, default=3)
    options = parser.parse_args()
    robot = load_robot('reference')
    told = RecursivePredictionError(robot, 'assumed_modes', options.modes)
    far = robot.with_link(1, youngs_modulus=(1.0 - OFF) * robot.links[1].youngs_modulus) \
        .with_drive(0, inertia=(1.0 + OFF) * robot.drives[0].inertia)
    wrong = RecursivePredictionError(far, 'assumed_modes', options.modes)
    found: dict[str, list[Array]] = {}
    for seed in range(options.seed, options.seed + options.runs):
        for truth in TRUTHS:
            case = draw_case(None, seed, duration_s=TIMES_S[-1] + 0.05)
            record = make_record(replace(case, simulator=truth))
            for name, spoil in spoils().items():
                spoilt = spoil(record, np.random.default_rng(seed))
                found.setdefault(name, []).append(answers(told, spoilt, case))
            found.setdefault('two parts 2 % off', []).append(answers(wrong, record, case))
    print(f'{"":24s}' + ''.join(f' |{f"{t:g} s: in, RMSE, worst, +-":>25s}' for t in TIMES_S))
    for name, runs in found.items():
        report(name, np.array(runs))


if __name__ == '__main__':
    main()
