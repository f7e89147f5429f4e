"""
Logs that were disturbed and can still be read, each diagnosed: a verdict or one line, always.

`python test/faults/disturbed_logs.py [--count N] [--seed S] [--page]`; one to three disturbances
of `attack/disturbances.py` a log, of two arms in motion, with and without torques that no effect
of the catalogue has.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import dataclass, replace
import json
import os
from pathlib import Path
import resource
import signal
import subprocess
import sys
from tempfile import TemporaryDirectory

from attack.disturbances import DISTURBANCES, Table
from faults.page import record
from flex_plant_sim.arm.robot import EffectSpec, Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.commissioning.standard_move import simulated_move, standard_move
from flex_plant_sim.logs.csv_log import write_csv
import numpy as np

# Strokes of the simulated move by arm; the log of either lasts 24 s.
STROKES = {'reference': 24, 'quanser_2dsfl': 12}
# Torques that no effect of the catalogue has: a brake of joint 2 that saturates with its speed,
# and a detent of joint 1, as shares of the drives' damping torque at 1 rad/s.
UNNAMED = (('joint_2', 'speed', (-0.2, -0.05, 0.05, 0.2), (0.15, 0.1, -0.1, -0.15)),
           ('joint_1', 'angle', (-0.1, 0.0, 0.1), (0.0, 0.12, 0.0)))
# Longest diagnosis, s of CPU, and longest line that refuses a log, characters.
LONGEST = 300
MOST = 300


@dataclass(frozen=True)
class Outcome:
    """Outcome of a log: its kind, what was done to it, time, s, and memory, MB."""

    kind: str
    done: str
    seconds: float
    memory: float


def pushed(robot: Robot) -> Robot:
    """Return a robot with torques that no effect of the catalogue has."""
    return replace(robot, effects=tuple(EffectSpec('measured_torque', site, {
        'variable': variable, 'knots': knots, 'torques_n_m': tuple(
            share * robot.drives[int(site[-1]) - 1].damping for share in shares)})
        for site, variable, knots, shares in UNNAMED))


def good(folder: Path) -> dict[tuple[str, bool], tuple[str, Table]]:
    """Return header and table of each arm's log, without and with torques that have no name."""
    found = {}
    for arm, strokes in STROKES.items():
        robot = load_robot(arm)
        for unnamed, moved in ((False, robot), (True, pushed(robot))):
            path = folder / f'{arm}_{unnamed}.csv'
            write_csv(path, simulated_move(moved, standard_move(moved, strokes), 3, 1))
            lines = [line for line in path.read_text().splitlines() if line[:1] != '#']
            found[arm, unnamed] = lines[0], np.loadtxt(lines[1:], delimiter=',')
    return found


def diagnosed(log: Path, arm: str, done: str) -> Outcome:
    """Return the outcome of flex_diagnose, as a process, on a log."""
    words, results = log.with_suffix('.txt'), log.with_suffix('.json')
    results.unlink(missing_ok=True)
    with words.open('w') as file:
        process = subprocess.Popen(
            [sys.executable, '-m', 'flex_payload_estimator.tools.diagnose', str(log),
             '--robot', arm, '--jobs', '1', '--json', str(results)],
            stdout=file, stderr=subprocess.STDOUT,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (LONGEST, LONGEST)))
        _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    seconds = usage.ru_utime + usage.ru_stime
    return Outcome(_kind(process.returncode, words.read_text(), results), done, seconds,
                   usage.ru_maxrss / 1e3)


def _kind(code: int, words: str, results: Path) -> str:
    if 'Traceback' in words:
        return 'traceback: ' + words.strip().splitlines()[-1][:150]
    if code in (-signal.SIGXCPU, -signal.SIGKILL):
        return 'hang'
    if code == 2:
        last = words.strip().splitlines()[-1]
        return 'refused' if len(last) <= MOST and ': ' in last else f'bad line: {last[:150]}'
    return str(json.loads(results.read_text())['verdict']) if not code else f'ended with {code}'


def disturb(number: int, seed: int, logs: dict[tuple[str, bool], tuple[str, Table]], path: Path
            ) -> tuple[str, str]:
    """Write a disturbed log; return its arm, and what was done to it."""
    rng = np.random.default_rng([seed, number])
    arm, unnamed = sorted(logs)[int(rng.integers(len(logs)))]
    header, table = logs[arm, unnamed][0], logs[arm, unnamed][1].copy()
    done = ['unnamed torques'] if unnamed else []
    for k in rng.integers(0, len(DISTURBANCES), int(rng.integers(1, 4))):
        if len(table) > 3:
            table = DISTURBANCES[k](rng, table)
            done.append(DISTURBANCES[k].__name__)
    np.savetxt(path, table, '%.10g', ',', header=header, comments='')
    return arm, ', '.join(done)


def main() -> int:
    """Diagnose so many disturbed logs; return 1 where one ended in neither verdict nor line."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument('--count', type=int, default=300)
    options.add_argument('--seed', type=int, default=1)
    options.add_argument('--page', action='store_true', help='write it into docs/faults.md')
    chosen = options.parse_args()
    found = []
    with TemporaryDirectory() as folder:
        logs = good(Path(folder))
        for number in range(chosen.count):
            path = Path(folder) / 'log.csv'
            arm, done = disturb(number, chosen.seed, logs, path)
            found.append(diagnosed(path, arm, done))
            print(number, arm, found[-1], flush=True)
    kinds = Counter(item.kind for item in found)
    wrong = sum(count for kind, count in kinds.items()
                if kind.startswith(('traceback', 'hang', 'bad line', 'ended')))
    record('disturbed logs', [
        f'{len(found)} logs: ' + ', '.join(f'{kind} {count}' for kind, count in
                                           kinds.most_common())
        + f'. {wrong} ended in neither a verdict nor one line. CPU time: median '
        f'{np.median([item.seconds for item in found]):.0f} s, at most '
        f'{max(item.seconds for item in found):.0f} s; memory at most '
        f'{max(item.memory for item in found):.0f} MB.'], chosen.page)
    return int(wrong > 0)


if __name__ == '__main__':
    sys.exit(main())
