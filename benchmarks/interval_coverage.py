"""
Count how often the default estimator's 95 % interval holds the payload.

`python benchmarks/interval_coverage.py` covers three kinds of truth: the model itself, arms whose
parts are drawn from the robot file's tolerances, and the records of an independent simulator in
`../shared/data/bench` (each hides an effect that the estimator is not told of).
Random cases as in accuracy.py, with other seeds.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from functools import lru_cache, partial
import json
from pathlib import Path

from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_plant_sim.arm.parts import robot_parts
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.interval import Z95
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from matched import Case, record, TORQUE_NOISE, wilson, workers
from matplotlib.figure import Figure
import numpy as np
from scipy.stats import norm

TIMES_S = (1.0, 3.0, 10.0)
KINDS = ('model', 'process noise', 'parts drawn')
FIRST_SEED = 100_000
ROOT = Path(__file__).resolve().parents[1]
BENCH = ROOT.parent / 'shared' / 'data' / 'bench'


@lru_cache(maxsize=1)
def nominal_arm(modes: int) -> ExtendedArm:
    """Return the reference arm, built once per process."""
    return ExtendedArm(load_robot('reference'), 'assumed_modes', modes)


def drawn(robot: Robot, seed: int) -> Robot:
    """Return the robot with every part drawn from its tolerance."""
    random = np.random.default_rng([seed, 2])
    for part in robot_parts(robot):
        robot = part.change(robot, part.tolerance * float(random.standard_normal()))
    return robot


def run(seed: int, kind: str, modes: int) -> Array:
    """Return error and stated standard deviation over the payload at TIMES_S, (2, 3)."""
    case = Case.draw(FIRST_SEED + seed, TORQUE_NOISE if kind == 'process noise' else 0.0)
    if kind == 'parts drawn':
        arm = ExtendedArm(drawn(load_robot('reference'), seed), 'assumed_modes', modes)
    else:
        arm = nominal_arm(modes)
    data = record(arm, case, TIMES_S[-1])
    gains = np.ones(data.outputs.shape[1])
    if kind == 'parts drawn':
        spread = arm.robot.tolerances.strain_gain
        gains[2:] += spread * np.random.default_rng([seed, 3]).standard_normal(gains.size - 2)
    estimator = make_estimator('rpe', case.robot(), 'assumed_modes', modes,
                               torque_noise=(case.torque, case.torque))
    command, found = np.zeros(2), []
    for time, output, after in zip(data.time, data.outputs, data.commands):
        estimate = estimator.update(time, gains * output, command)
        command = after
        if np.min(np.abs(time - np.array(TIMES_S))) < 1e-6:
            found.append(((estimate.mass - case.mass) / case.mass,
                          estimate.variance**0.5 / case.mass))
    return np.array(found).T


def report(kind: str, found: Array) -> None:
    """Print one kind's coverage; found is (runs, 2, times)."""
    for k, time in enumerate(TIMES_S):
        inside = int(np.sum(np.abs(found[:, 0, k]) < Z95 * found[:, 1, k]))
        low, high = wilson(inside, len(found))
        print(f'{kind:18s}{time:5g}{len(found):6d}{100 * inside / len(found):8.1f}%'
              f'{100 * low:8.1f} -{100 * high:5.1f}%'
              f'{100 * np.sqrt(np.mean(found[:, 0, k]**2)):12.4f}'
              f'{100 * np.median(found[:, 1, k]):14.4f}', flush=True)


def bench_answers(name: str, truth: dict[str, object]) -> tuple[Array, list[str]]:
    """Return (time, mass, standard deviation) over a record, and its events in words."""
    rows = np.loadtxt(BENCH / f'{name}.csv', delimiter=',', skiprows=1)
    estimator = RecursivePredictionError(load_robot('reference'))
    command, found = np.zeros(2), []
    for row in rows:
        estimate = estimator.update(row[0], row[3:9], command)
        command = row[1:3]
        found.append((row[0], estimate.mass, estimate.variance**0.5))
    events = [f'change at {event.time:.2f} s found at {event.found:.2f} s: '
              f'{event.before:.4f} -> {event.after:.4f} kg' for event in estimator.events]
    return np.array(found), events


def bench_records() -> Iterator[tuple[str, Array]]:
    """Print the estimates on the bench records; yield name and (time, relative error and std)."""
    truths = json.loads((BENCH / 'truth.json').read_text())
    columns = ''.join(f'{f"error at {time:g} s":>16s}' for time in TIMES_S)
    print(f'{"record":18s}{columns}{"in 95 % at 10 s":>18s}')
    for name, truth in truths.items():
        found, events = bench_answers(name, truth)
        time, mass = found[:, 0], np.full(len(found), truth['payload_true'])
        drop = truth['effect'].get('payload_drop')
        if drop:
            mass[time >= drop[0]] = drop[1]
        error, std = found[:, 1] / mass - 1.0, found[:, 2] / mass
        at = [int(np.argmin(np.abs(time - t))) for t in TIMES_S]
        texts = ''.join(f'{100 * error[k]:8.1f} ±{100 * std[k]:5.1f}%' for k in at)
        inside = bool(abs(error[at[-1]]) < Z95 * std[at[-1]])
        print(f'{truth["name"]:18s}{texts}{"yes" if inside else "no":>18s}')
        for event in events:
            print(f'    {event}')
        if drop:
            late = int(np.argmin(np.abs(time - drop[0] - 2.0)))
            print(f'    dropped at {drop[0]:.2f} s; 2 s later {100 * error[late]:+.1f} %')
        yield truth['name'], np.stack([time, error, std])


def draw(studies: dict[str, Array], records: dict[str, Array], path: Path) -> None:
    """Plot the quantiles of error over standard deviation, and the records over time."""
    figure = Figure(figsize=(11, 8), layout='constrained')
    grid = figure.add_gridspec(3, 12)
    panels = [figure.add_subplot(grid[0, 4 * k:4 * k + 4]) for k in range(3)]
    for axis, (kind, found) in zip(panels, studies.items()):
        levels = (np.arange(len(found)) + 0.5) / len(found)
        for k, time in enumerate(TIMES_S):
            axis.plot(levels, np.sort(norm.cdf(found[:, 0, k] / found[:, 1, k])),
                      label=f'{time:g} s')
        axis.plot([0, 1], [0, 1], 'k--', lw=1)
        axis.set(title=kind, xlabel='stated probability')
    panels[0].set(ylabel='observed share')
    panels[0].legend()
    axes = [figure.add_subplot(grid[1 + k // 4, 3 * (k % 4):3 * (k % 4) + 3]) for k in range(8)]
    for axis, (name, (time, error, std)) in zip(axes, records.items()):
        axis.fill_between(time, 100 * (error - Z95 * std), 100 * (error + Z95 * std),
                          color='C0', alpha=0.25, lw=0)
        axis.plot(time, 100 * error, 'C0', lw=1)
        axis.axhline(0.0, color='k', lw=0.8)
        axis.set(title=name, ylim=(-40, 40))
        axis.grid(alpha=0.3)
    for axis in axes[4:]:
        axis.set(xlabel='time, s')
    for axis in axes[::4]:
        axis.set(ylabel='error, %')
    figure.savefig(path, dpi=150)


def main() -> None:
    """Run, print and draw if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--runs', type=int, default=300)
    parser.add_argument('--modes', type=int, default=3)
    parser.add_argument('--jobs', type=int, default=2)
    parser.add_argument('--seed', type=int, default=0, help='first')
    parser.add_argument('--kinds', nargs='+', default=KINDS, choices=KINDS,
                        help='the bench records follow all')
    parser.add_argument('--figure', type=Path, metavar='PNG', help='where to draw them all')
    options = parser.parse_args()
    print(f'{"truth":18s}{"at s":>5s}{"runs":>6s}{"in 95 %":>9s}{"its interval":>15s}'
          f'{"RMSE %":>13s}{"median std %":>14s}')
    studies, seeds = {}, range(options.seed, options.seed + options.runs)
    with workers(options.jobs) as pool:
        for kind in options.kinds:
            job = partial(run, kind=kind, modes=options.modes)
            studies[kind] = np.array(pool.map(job, seeds, chunksize=5))
            report(kind, studies[kind])
    if len(studies) < len(KINDS):
        return
    if not BENCH.is_dir():
        print(f'the bench records are absent: expected {BENCH.relative_to(ROOT.parent)}')
        return
    records = dict(bench_records())
    if options.figure:
        draw(studies, records, options.figure)


if __name__ == '__main__':
    main()
