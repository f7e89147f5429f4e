"""
Compare the default estimator's error with the Cramer-Rao bound, on matched models.

`python benchmarks/accuracy.py` runs 500 random cases without and 500 with process noise:
payload 0.03-0.3 kg, noise 1e-4-1e-2 (rad, and V on the gauges), assumed modes, n = 3. --model,
--step and --until, s, change that. --told divides the noise that the estimator is told by a
factor, --burst adds a multiple of the noise from 3 to 3.5 s (the bound is that without it).
The bound has the same vague start as the estimator; with process noise it is the posterior one.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from functools import lru_cache, partial

from flex_payload_estimator.estimators.factory import make_estimator
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from matched import bound, Case, coverage, Record, record, TORQUE_NOISE, workers
import numpy as np

# Times at which errors are compared, s, without and with a burst; the burst's begin and end, s.
TIMES_S, AFTER_S = (1.0, 3.0, 10.0), (3.0, 4.0, 5.0, 6.0, 6.5)
BURST_S = (3.0, 3.5)
NAMES = ('no process noise', 'process noise')


@dataclass(frozen=True)
class Study:
    """
    Settings that all runs share.

    Attributes
    ----------
    model : str
    modes : int
        Modes per link.
    step, until : float
        Sampling interval and end of a run, s.
    told : float
        Factor by which the noise is larger than the estimator is told.
    burst : float
        Noise during the burst, as a multiple of the noise; 0 for none.

    """

    model: str = 'assumed_modes'
    modes: int = 3
    step: float = 0.01
    until: float = TIMES_S[-1]
    told: float = 1.0
    burst: float = 0.0

    @property
    def times(self) -> tuple[float, ...]:
        """Return the times, s, at which the runs are compared, up to their end."""
        return tuple(t for t in (AFTER_S if self.burst else TIMES_S) if t <= self.until)


@lru_cache(maxsize=1)
def _nominal(study: Study) -> ExtendedArm:
    """Return the reference arm, built once per process."""
    robot = replace(load_robot('reference'), sample_time=study.step)
    return ExtendedArm(robot, study.model, study.modes)


def run(seed: int, torque: float, study: Study) -> Array:
    """Return error, stated standard deviation and bound, kg, at the times, (3, times)."""
    case, arm = Case.draw(seed, torque, study.step), _nominal(study)
    data, robot = record(arm, case, study.until), case.robot()
    robot = replace(robot, angle_noise=robot.angle_noise / study.told,
                    strain_noise=robot.strain_noise / study.told)
    estimator = make_estimator('rpe', robot, study.model, study.modes,
                               torque_noise=(torque, torque))
    command, estimates = np.zeros(2), []
    for time, output, after in zip(data.time, _measured(case, data, study), data.commands):
        estimates.append(estimator.update(time, output, command))
        command = after
    limit = bound(arm, case, data)
    return np.array([(estimates[k].mass - case.mass, estimates[k].variance**0.5, limit[k])
                     for k in (round(time / study.step) for time in study.times)]).T


def _measured(case: Case, data: Record, study: Study) -> Array:
    """Return the outputs that the estimator gets, with a burst of noise if asked."""
    during = (data.time > BURST_S[0] - 1e-9) & (data.time < BURST_S[1] - 1e-9)
    robot, random = case.robot(), np.random.default_rng([case.seed, 3])
    size = np.array([robot.angle_noise] * 2 + [robot.strain_noise] * (data.outputs.shape[1] - 2))
    more = study.burst * size * random.standard_normal(data.outputs.shape)
    return data.outputs + np.where(during[:, None], more, 0.0)


def report(name: str, found: Array, times: tuple[float, ...]) -> None:
    """Print RMSE over bound and coverage; found is (runs, 3, times)."""
    error, std, limit = found[:, 0], found[:, 1], found[:, 2]
    print(f'{name}, {len(found)} runs')
    print(f'{"at s":>6s}{"RMSE/CRB":>10s}{"median CRB g":>14s}{"std/CRB":>9s}{"in 95 %":>9s}'
          f'{"its interval":>16s}{"worst error/std":>17s}')
    for k, time in enumerate(times):
        ratio = np.sqrt(np.mean((error[:, k] / limit[:, k])**2))
        print(f'{time:6g}{ratio:10.3f}{1e3 * np.median(limit[:, k]):14.5f}'
              f'{np.median(std[:, k] / limit[:, k]):9.3f}{coverage(error[:, k], std[:, k])}'
              f'{np.max(np.abs(error[:, k]) / std[:, k]):17.1f}', flush=True)


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--runs', type=int, default=500)
    parser.add_argument('--modes', type=int, default=3)
    parser.add_argument('--jobs', type=int, default=2)
    parser.add_argument('--seed', type=int, default=0, help='first')
    parser.add_argument('--model', default='assumed_modes')
    parser.add_argument('--step', type=float, default=0.01)
    parser.add_argument('--until', type=float, default=TIMES_S[-1])
    parser.add_argument('--told', type=float, default=1.0)
    parser.add_argument('--burst', type=float, default=0.0, metavar='TIMES')
    parser.add_argument('--torque', nargs='*', type=float, default=(0.0, TORQUE_NOISE))
    options = parser.parse_args()
    study = Study(options.model, options.modes, options.step, options.until, options.told,
                  options.burst)
    with workers(options.jobs) as pool:
        for torque in options.torque:
            seeds, name = range(options.seed, options.seed + options.runs), NAMES[torque > 0.0]
            job = partial(run, torque=torque, study=study)
            report(name, np.array(pool.map(job, seeds, chunksize=5)), study.times)


if __name__ == '__main__':
    main()
