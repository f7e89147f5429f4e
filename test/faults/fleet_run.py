"""
A night's logs on one worker, on two, and on two of which one is killed -9 in the middle.

`python test/faults/fleet_run.py [--logs 64] [--seconds 21] [--runs one two killed] [--page]`
prints how long each took, and whether the tables are the same. Of sixteen arms one moves, with
payloads that are not told; the others rest, which keeps the run short.
"""

from __future__ import annotations

import argparse
from contextlib import suppress
import csv
from dataclasses import dataclass
from pathlib import Path
import subprocess
import sys
from tempfile import TemporaryDirectory
import time

from faults.page import record
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.logs.csv_log import write_csv
from flex_plant_sim.logs.log import Log
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import simulate, Simulator
import numpy as np
import psutil

ARMS, MOVING = 16, 'arm_00'
RUNS = {'one': 1, 'two': 2, 'killed': 2}
ANSWERS = ('arm', 'log', 'verdict', 'causes', 'probability', 'payload_kg', 'payload_std_kg',
           'since', 'error')


@dataclass(frozen=True)
class Night:
    """Result of a run: its table, its time, and the time of a log in motion and at rest, s."""

    rows: list[dict[str, str]]
    seconds: float
    moving: float
    resting: float


def write_log(path: Path, number: int, seconds: float) -> None:
    """Write the log of an arm: small steps with a payload of its own, or rest."""
    robot, rng = load_robot('reference'), np.random.default_rng(number)
    time_s = np.arange(0.0, seconds, robot.sample_time)
    moves = path.parent.name == MOVING
    command = moves * np.sign(np.sin(np.outer(time_s, rng.uniform(1.5, 4.0, 2))))
    arm = ExtendedArm(robot, 'assumed_modes', 2, rng.uniform(0.05, 0.2))
    output, _ = simulate(Simulator(arm), command)
    output = output + rng.standard_normal(output.shape) * np.repeat(
        [robot.angle_noise, robot.strain_noise], [2, 4])
    path.parent.mkdir(parents=True, exist_ok=True)
    write_csv(path, Log(path.stem, time_s, command, output[:, :2], output[:, 2:],
                        robot.gauge_names))


def fleet(folder: Path, out: str, workers: int, kill_after: int | None = None) -> Night:
    """Run flex_fleet on the night; kill a worker once so many rows are on the disk."""
    begin = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, '-m', 'flex_payload_estimator.tools.fleet', 'night', '--out', out,
         '--workers', str(workers)], cwd=folder, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL)
    if kill_after is not None:
        kill_a_worker(process, folder / out / 'fleet.jsonl', kill_after)
    assert process.wait() == 0
    took = time.monotonic() - begin
    with (folder / out / 'fleet.csv').open(newline='') as file:
        rows = list(csv.DictReader(file))
    each: dict[bool, list[float]] = {True: [], False: []}
    for row in rows:
        each[Path(row['log']).parent.name == MOVING].append(float(row['seconds']))
    return Night([{key: row[key] for key in ANSWERS} for row in rows], took,
                 float(np.median(each[True])), float(np.median(each[False])))


def killed_at_work(fleet: int) -> bool:
    """Kill -9 a fleet's worker that waits for flex_diagnose; return whether there was one."""
    for process in psutil.Process(fleet).children(recursive=True):
        # A process may have ended since it was listed.
        with suppress(psutil.Error):
            parent = process.parent()
            if any('tools.diagnose' in word for word in process.cmdline()) \
                    and parent is not None and parent.pid != fleet:
                parent.kill()
                return True
    return False


def kill_a_worker(fleet: subprocess.Popen[bytes], journal: Path, rows: int) -> None:
    """Kill -9 a worker that waits for flex_diagnose, in the middle of the night."""
    while fleet.poll() is None:
        time.sleep(0.02)
        done = journal.exists() and len(journal.read_bytes().splitlines()) >= rows
        if done and killed_at_work(fleet.pid):
            return
    raise AssertionError('flex_fleet ended before a worker was killed')


def said(nights: dict[str, Night], seconds: float) -> list[str]:
    """Return the lines of the page: times, their ratio, what differs between the tables."""
    lines = ['| workers | logs | time, s | a log in motion, s | at rest, s | logs an hour | '
             'a hundred thousand logs, h |', '|---|---|---|---|---|---|---|']
    for name, night in nights.items():
        hourly = 3600.0 * len(night.rows) / night.seconds
        workers = f'{RUNS[name]}, one killed -9' if name == 'killed' else RUNS[name]
        lines.append(f'| {workers} | {len(night.rows)} of {seconds:g} s | {night.seconds:.0f} | '
                     f'{night.moving:.1f} | {night.resting:.1f} | {hourly:.0f} | '
                     f'{1e5 / hourly:.0f} |')
    tables = [night.rows for night in nights.values()]
    differ = max(sum(a != b for a, b in zip(tables[0], rows)) + abs(len(rows) - len(tables[0]))
                 for rows in tables)
    lines += ['', f'Rows that differ between the {len(tables)} tables: {differ}; rows with an '
              f'error: {sum(bool(row["error"]) for rows in tables for row in rows)}.']
    if {'one', 'two'} <= set(nights):
        ratio = nights['one'].seconds / nights['two'].seconds
        lines[-1] += f' Two workers are {ratio:.2f} times as fast as one.'
    return lines


def main() -> None:
    """Write the night, run it so many times, print what came of it."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument('--logs', type=int, default=64)
    options.add_argument('--seconds', type=float, default=21.0, help='length of a log')
    options.add_argument('--runs', nargs='+', choices=RUNS, default=list(RUNS))
    options.add_argument('--page', action='store_true', help='write it into docs/faults.md')
    chosen = options.parse_args()
    with TemporaryDirectory() as name:
        folder, nights = Path(name), {}
        for number in range(chosen.logs):
            write_log(folder / 'night' / f'arm_{number % ARMS:02d}' / f'{number // ARMS}.csv',
                      number, chosen.seconds)
        for run in chosen.runs:
            kill = chosen.logs // 2 if run == 'killed' else None
            nights[run] = fleet(folder, run, RUNS[run], kill)
            print(f'{run}: {nights[run].seconds:.1f} s', flush=True)
    record('fleet', said(nights, chosen.seconds), chosen.page)


if __name__ == '__main__':
    main()
