"""
Attack the readers with mutated files; print and count the outcomes.

    python -m attack.run csv 10000 --seed 1     (from the folder test; kinds: csv, bag, robot)
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
import random
import re
import sys
from tempfile import TemporaryDirectory
import time
from typing import Any

from attack.mutations import BYTES, Mutation, TABLE, YAML
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot, parse_robot, robot_text
from flex_plant_sim.logs.bag_log import write_bag
from flex_plant_sim.logs.csv_log import write_csv
from flex_plant_sim.logs.log import Log
from flex_plant_sim.logs.read import read_log
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import simulate, Simulator
from flex_plant_sim.tools.log_input import hints
from msg_config.errors import InputError, LONGEST
import numpy as np

ROBOT = load_robot('reference')
# Longest time of an attack, s of CPU, and largest memory, bytes.
LIMIT = {'csv': 5.0, 'robot': 5.0, 'bag': 20.0}
MEMORY = 600e6
# A change of a sample by less than this share of its channel's range, as by a lost digit, does not
# mislead.
SENSE = 0.05
# Nor does a robot's number that is off by less than its tolerance in the robot file: number to
# tolerance.
TOLERANCE = {'youngs_modulus': 'stiffness', 'density': 'link_mass', 'damping_ratio': 'damping',
             'length': 'length', 'elbow_mass': 'elbow_mass', 'elbow_inertia': 'elbow_inertia',
             'payload_mass': 'payload'}


@dataclass(frozen=True)
class Outcome:
    """The outcome of one attack: its kind, and a description where it is a fault."""

    kind: str
    text: str = ''


def good_log(samples: int = 150) -> Log:
    """Return a record of the reference arm in motion."""
    time_s = 0.01 * np.arange(float(samples))
    command = np.stack([np.sign(np.sin(4.0 * time_s)), np.sin(7.0 * time_s)], axis=1)
    output, rate = simulate(Simulator(ExtendedArm(ROBOT, 'assumed_modes', 2, 0.1)), command)
    rng = np.random.default_rng(0)
    noise = rng.standard_normal(output.shape) * np.repeat([2e-4, 5e-7], [2, 4])
    output = output + noise
    return Log('good', time_s, command, output[:, :2], output[:, 2:], ROBOT.gauge_names)


def misled(found: Log, good: Log) -> str:
    """Return how a log differs from the original without a warning; empty if it does not."""
    if len(found) > len(good):
        return f'{len(found)} of {len(good)} rows'
    if found.notes or found.doubts or hints(found, ROBOT):
        return ''
    # The remaining part of a log may begin later.
    later = [good.part(shift, len(good)) for shift in range(len(good) - 2)]
    scale = np.ptp(np.hstack([good.command, good.output]), axis=0)
    best = min((_worst(found, rest, scale) for rest in later), key=lambda item: item[0])
    return '' if best[0] <= SENSE else f'{best[1]} off by {best[0]:.3g} of its range'


def _worst(a: Log, b: Log, scale: np.ndarray) -> tuple[float, str]:
    rows = min(len(a), len(b))
    off = np.abs(np.hstack([a.command, a.output])[:rows] - np.hstack([b.command, b.output])[:rows])
    if rows == len(a):
        off[-1, :2] = 0.0  # a command acts after its row: on nothing here
    share = off.max(axis=0) / scale
    names = ('command_1', 'command_2', *b.output_names)
    return float(share.max()), names[int(share.argmax())]


def changed(found: Robot, good: Robot) -> str:
    """Return how a robot differs from the original and `flex_robot check` does not list it."""
    listed = [value for key, value in found.left_out.items() if key not in good.left_out]
    return '; '.join(
        f'{key}: {a!r} for {b!r}' for (key, a), (_, b) in zip(_values(found), _values(good))
        if a != b and a not in listed and not _tolerated(key.split('.')[-1], a, b, good))


def _tolerated(key: str, a: Any, b: Any, good: Robot) -> bool:
    share: float = getattr(good.tolerances, TOLERANCE[key]) if key in TOLERANCE else 0.0
    return bool(share and abs(a - b) <= share * abs(b))


def _values(item: Any, key: str = '') -> Iterator[tuple[str, Any]]:
    if is_dataclass(item):
        for name in (field.name for field in fields(item) if field.compare):
            yield from _values(getattr(item, name), f'{key}.{name}')
    elif isinstance(item, tuple) and item and is_dataclass(item[0]):
        for k, part in enumerate(item):
            yield from _values(part, f'{key}[{k}]')
    elif key != '.name':  # a title; nothing is computed from it
        yield key, item


def line_fault(error: InputError) -> str:
    """Return what is wrong with an error line; empty where nothing is."""
    text = str(error)
    if len(text) > LONGEST or '\n' in text:
        return f'a line of {len(text)} characters'
    return '' if ': ' in text else f'a line without a place: {text}'


class Attack:
    """
    One kind of attack.

    Parameters
    ----------
    kind : str
        csv, bag or robot.
    folder : Path
        Folder for its files.

    """

    def __init__(self, kind: str, folder: Path):
        self.kind, self.good = kind, good_log()
        self.mutations: tuple[Mutation, ...] = BYTES + {
            'csv': TABLE, 'robot': YAML, 'bag': ()}[kind]
        if kind == 'csv':
            self.files = [folder / 'log.csv']
            write_csv(self.files[0], self.good)
        elif kind == 'bag':
            write_bag(folder / 'a', self.good, 'mcap')
            write_bag(folder / 'b', self.good, 'sqlite3')
            self.files = [folder / 'a' / 'a.mcap', folder / 'b' / 'b.db3',
                          folder / 'a' / 'metadata.yaml', folder / 'b' / 'metadata.yaml']
        else:
            self.files = [folder / f'{name}.yaml' for name in ('reference', 'quanser_2dsfl')]
            for file in self.files:
                file.write_text(robot_text(file.stem))
        self.data = {file: file.read_bytes() for file in self.files}

    def strike(self, rng: random.Random) -> Outcome:
        """Mutate one file, read it, and put it back."""
        file = rng.choice(self.files)
        data = self.data[file]
        for _ in range(1 if rng.random() < 0.7 else 2):
            data = rng.choice(self.mutations)(rng, data) if data else data
        file.write_bytes(data)
        begin = time.process_time()  # others may use the machine
        try:
            outcome = self._read(file, rng)
        except InputError as error:
            fault = line_fault(error)
            outcome = Outcome('bad line', fault) if fault else Outcome('refused')
        except Exception as error:  # noqa: B902  that is what is counted
            outcome = Outcome('traceback', f'{type(error).__name__}: {str(error)[:200]}')
        finally:
            file.write_bytes(self.data[file])
        took = time.process_time() - begin
        return Outcome('hang', f'{took:.1f} s') if took > LIMIT[self.kind] else outcome

    def _read(self, file: Path, rng: random.Random) -> Outcome:
        if self.kind == 'robot':
            wrong = changed(load_robot(file), parse_robot(self.data[file].decode(), str(file)))
            return Outcome('read as another robot', wrong) if wrong else Outcome('read')
        single = self.kind == 'csv' or (file.suffix != '.yaml' and rng.random() < 0.5)
        log = read_log(file if single else file.parent, ROBOT)
        wrong = misled(log, self.good)
        return Outcome('misled', wrong) if wrong else Outcome('read')


def attack(kind: str, count: int, seed: int, show: bool = False) -> Counter[str]:
    """Return the number of outcomes by kind of `count` attacks."""
    counts: Counter[str] = Counter()
    with TemporaryDirectory() as folder:
        plan = Attack(kind, Path(folder))
        for k in range(count):
            outcome = plan.strike(random.Random(f'{kind} {seed} {k}'))
            counts[outcome.kind] += 1
            if show and outcome.text:
                print(f'{kind} {seed} {k}: {outcome.kind}: {outcome.text}', flush=True)
    return counts


def main() -> int:
    """Attack, print the counts, and return 1 where there was a fault."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument('kind', choices=sorted(LIMIT))
    options.add_argument('count', type=int)
    options.add_argument('--seed', type=int, default=0)
    chosen = options.parse_args()
    counts = attack(chosen.kind, chosen.count, chosen.seed, show=True)
    # Not by getrusage: a process inherits the largest size of the one that started it.
    peak = re.search(r'VmHWM:\s*(\d+) kB', Path('/proc/self/status').read_text())
    assert peak is not None
    memory = int(peak[1]) * 1024
    print(f'{chosen.kind}, seed {chosen.seed}, {chosen.count} attacks: {dict(counts)}; at most '
          f'{memory / 1e6:.0f} MB')
    return int(bool(counts['traceback'] or counts['hang'] or counts['bad line']
                    or memory > MEMORY))


if __name__ == '__main__':
    sys.exit(main())
