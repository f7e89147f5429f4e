"""
Compare the default estimator's error with the Cramer-Rao bound, on matched models.

`python benchmarks/accuracy.py` runs 500 random cases without and 500 with process noise:
payload 0.03-0.3 kg, noise 1e-4-1e-2 (rad, and V on the gauges), assumed modes, n = 3.
The bound has the same vague start as the estimator; with process noise it is the posterior one.
"""

from __future__ import annotations

import argparse
from functools import lru_cache, partial
from pathlib import Path

from flex_payload_estimator.estimators.factory import make_estimator
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from matched import bound, Case, record, TORQUE_NOISE, wilson, workers
from matplotlib.figure import Figure
import numpy as np

TIMES_S = (1.0, 3.0, 10.0)
LIMIT = 1.5
FIGURE = Path(__file__).resolve().parents[1] / 'docs' / 'figures' / 'accuracy.png'


@lru_cache(maxsize=1)
def arm_of(modes: int) -> ExtendedArm:
    """Return the reference arm, built once a process."""
    return ExtendedArm(load_robot('reference'), 'assumed_modes', modes)


def run(seed: int, torque: float, modes: int) -> Array:
    """Return error, stated standard deviation and bound, kg, at TIMES_S, (3, 3)."""
    case, arm = Case.draw(seed, torque), arm_of(modes)
    data = record(arm, case, TIMES_S[-1])
    estimator = make_estimator('rpe', case.robot(), 'assumed_modes', modes,
                               torque_noise=(torque, torque))
    command, estimates = np.zeros(2), []
    for time, output, after in zip(data.time, data.outputs, data.commands):
        estimates.append(estimator.update(time, output, command))
        command = after
    limit = bound(arm, case, data)
    return np.array([(estimates[k].mass - case.mass, estimates[k].variance**0.5, limit[k])
                     for k in (round(time / 0.01) for time in TIMES_S)]).T


def report(name: str, found: Array) -> None:
    """Print RMSE over bound and coverage; found is (runs, 3, times)."""
    error, std, limit = found[:, 0], found[:, 1], found[:, 2]
    print(f'{name}, {len(found)} runs')
    print(f'{"at s":>6s}{"RMSE/CRB":>10s}{"median CRB g":>14s}{"std/CRB":>9s}{"in 95 %":>9s}'
          f'{"its interval":>16s}{"worst error/std":>17s}')
    for k, time in enumerate(TIMES_S):
        ratio = np.sqrt(np.mean((error[:, k] / limit[:, k])**2))
        inside = int(np.sum(np.abs(error[:, k]) < 1.96 * std[:, k]))
        low, high = wilson(inside, len(found))
        print(f'{time:6g}{ratio:10.3f}{1e3 * np.median(limit[:, k]):14.5f}'
              f'{np.median(std[:, k] / limit[:, k]):9.3f}{100 * inside / len(found):8.1f}%'
              f'{100 * low:8.1f} -{100 * high:5.1f}%'
              f'{np.max(np.abs(error[:, k]) / std[:, k]):17.1f}', flush=True)


def draw(studies: dict[str, Array]) -> None:
    """Plot every run's error against its bound."""
    figure = Figure(figsize=(9, 4.2), layout='constrained')
    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    for axis, (name, found) in zip(axes, studies.items()):
        low, high = 0.3 * found[:, 2].min() * 1e3, 3.0 * found[:, 2].max() * 1e3
        axis.loglog([low, high], [low, high], 'k-', lw=1, label='bound')
        axis.loglog([low, high], [LIMIT * low, LIMIT * high], 'k--', lw=1,
                    label=f'{LIMIT:g} × bound')
        for k, time in enumerate(TIMES_S):
            bins = np.array_split(np.argsort(found[:, 2, k]), max(1, len(found) // 50))
            rms = [(np.median(found[b, 2, k]), np.sqrt(np.mean(found[b, 0, k]**2))) for b in bins]
            axis.loglog(1e3 * found[:, 2, k], 1e3 * np.abs(found[:, 0, k]), '.', ms=2, alpha=0.4,
                        color=f'C{k}')
            axis.loglog(*(1e3 * np.array(rms).T), 'o-', ms=4, color=f'C{k}',
                        label=f'RMSE at {time:g} s')
        axis.set(title=name, xlabel='Cramér–Rao bound, g')
        axis.grid(alpha=0.3)
    axes[0].set(ylabel='error of the payload, g')
    axes[0].legend(fontsize=8)
    figure.savefig(FIGURE, dpi=150)


def main() -> None:
    """Run, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--runs', type=int, default=500)
    parser.add_argument('--modes', type=int, default=3)
    parser.add_argument('--jobs', type=int, default=2)
    parser.add_argument('--no-figure', action='store_true')
    options = parser.parse_args()
    studies = {}
    with workers(options.jobs) as pool:
        for name, torque in (('no process noise', 0.0), ('process noise', TORQUE_NOISE)):
            job = partial(run, torque=torque, modes=options.modes)
            studies[name] = np.array(pool.map(job, range(options.runs), chunksize=5))
            report(name, studies[name])
    if not options.no_figure:
        draw(studies)


if __name__ == '__main__':
    main()
