"""
Estimate the payload of clean MuJoCo arms whose parts are all off by a given share.

`python benchmarks/parts_off.py --off 0.004 0.02 0.05 --step 0.01` makes every part of the links,
the drives and the elbow, and every gauge's gain, larger or smaller by --off; the seed decides
which. The robot file that rpe is told has that share for all their tolerances, or with --as-filed
its usual ones. Prints, for each share, coverage of the 95 % interval, root mean square and worst
of the errors and mean half width, in % of the payload, and false changes of it. Nothing is tuned
on it.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial
from multiprocessing import get_context

import _truths  # noqa: F401
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.interval import Z95
from model_error import rows_of
import numpy as np
from truth.configuration import Arm, Joint, Link, reference_arm
from truth.excitation import set_points
from truth.mujoco.simulation import simulate
from truth.records import COLUMNS, Record, sample_times
from truth.sensors import amplifier_output, quantise, sensor_noise

TIMES_S = (1.0, 3.0, 6.0, 10.0)
PAYLOADS_KG = (0.05, 0.2)
PARTS = ('stiffness', 'link_mass', 'drive_inertia', 'drive_gain', 'drive_damping', 'elbow_mass',
         'elbow_inertia', 'strain_gain')


def arm_off(off: float, step: float, random: np.random.Generator) -> Arm:
    """Return the reference arm with a drawn payload and every part larger or smaller by `off`."""
    arm = reference_arm(float(random.uniform(*PAYLOADS_KG)))

    def factor() -> float:
        return float(1.0 + off * random.choice((-1.0, 1.0)))

    def link(part: Link) -> Link:
        return replace(part, youngs_modulus=part.youngs_modulus * factor(),
                       density=part.density * factor())

    def joint(part: Joint) -> Joint:
        stiffer = factor()
        return replace(part, inertia=part.inertia * factor(), damping=part.damping * stiffer,
                       torque_gain=part.torque_gain * stiffer * factor())

    return replace(
        arm, sample_time=step, links=(link(arm.links[0]), link(arm.links[1])),
        joints=(joint(arm.joints[0]), joint(arm.joints[1])),
        sensors=replace(arm.sensors, strain_gain=tuple(
            factor() for _ in arm.sensors.strain_gain)),
        structure=replace(arm.structure, elbow_mass=arm.structure.elbow_mass * factor(),
                          elbow_inertia=arm.structure.elbow_inertia * factor()))


def record_of(arm: Arm, until: float, random: np.random.Generator) -> Record:
    """Return a log of the arm in random moves."""
    time = sample_times(arm, round(until / arm.sample_time) + 1)
    sensors, reference = arm.sensors, set_points(random, time, arm.excitation)
    motion = simulate(arm, reference, None, sensor_noise(
        random, reference.shape, sensors.angle_noise, arm.sample_time))
    strain = amplifier_output(motion, sensors, arm.sample_time)
    strain += sensor_noise(random, strain.shape, sensors.strain_noise, arm.sample_time)
    return Record(time, motion.command, motion.joint, quantise(strain, sensors.strain_step),
                  COLUMNS['reference'])


def told(off: float, step: float, as_filed: bool) -> Robot:
    """Return the robot that the estimator is told."""
    robot = replace(load_robot('reference'), sample_time=step)
    if as_filed:
        return robot
    return replace(robot, tolerances=replace(robot.tolerances, **dict.fromkeys(PARTS, off)))


def run(seed: int, off: float, step: float, until: float, as_filed: bool) -> Array:
    """Return relative error and standard deviation, and changes found so far, (3, times)."""
    random = np.random.default_rng(seed)
    arm = arm_off(off, step, random)
    estimator = RecursivePredictionError(told(off, step, as_filed))
    found = [estimator.update(*row) for row in rows_of(record_of(arm, until, random))]
    at = [found[round(time / step)] for time in TIMES_S if time <= until]
    mass = arm.payload.mass
    return np.array([[(a.mass - mass) / mass for a in at],
                     [a.variance**0.5 / mass for a in at], [len(estimator.events)] * len(at)])


def report(name: str, found: Array) -> None:
    """Print a line of (runs, 3, times)."""
    error, deviation = 100.0 * found[:, 0], 100.0 * found[:, 1]
    inside = np.abs(error) < Z95 * deviation
    cells = ''.join(
        f' |{inside[:, k].sum():4d}{np.sqrt(np.mean(error[:, k]**2)):6.2f}'
        f'{np.abs(error[:, k]).max():6.2f}{Z95 * deviation[:, k].mean():6.2f}'
        for k in range(error.shape[1]))
    print(f'{name:>8s}{len(found):5d}{cells} | {np.sum(found[:, 2, 0] > 0)}', flush=True)


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--off', type=float, nargs='+', default=(0.004, 0.02, 0.05))
    parser.add_argument('--step', type=float, default=0.01, help='s')
    parser.add_argument('--until', type=float, default=TIMES_S[-1], help='s')
    parser.add_argument('--runs', type=int, default=30)
    parser.add_argument('--seed', type=int, default=0, help='first')
    parser.add_argument('--jobs', type=int, default=2)
    parser.add_argument('--as-filed', action='store_true')
    options = parser.parse_args()
    times = [time for time in TIMES_S if time <= options.until]
    print(f'{"parts":>8s}{"runs":>5s}' + ''.join(
        f' |{f"{t:g} s in, RMSE, worst, +-":>22s}' for t in times) + ' | with a false change')
    seeds = range(options.seed, options.seed + options.runs)
    with get_context('spawn').Pool(options.jobs) as pool:
        for off in options.off:
            one = partial(run, off=off, step=options.step, until=options.until,
                          as_filed=options.as_filed)
            report(f'{100.0 * off:g} %', np.array(list(pool.imap(one, seeds))))


if __name__ == '__main__':
    main()
