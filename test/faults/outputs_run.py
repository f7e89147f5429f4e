"""
Every tool with every output option, pointed where it must not write.

`python test/faults/outputs_run.py [--page]`: at its inputs, at a user's file and folder, at a disk
that is full or fills, at a read-only place. Counts the user's bytes that are lost, what is left
half-written, and what is not refused in one line. Disks need the right to mount; they are mounted
in a namespace of their own.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
import ctypes
import hashlib
import io
import os
from pathlib import Path
import subprocess
import sys
from tempfile import TemporaryDirectory

from faults.fleet_run import write_log
from faults.page import record
from flex_payload_estimator.tools import demo, diagnose, estimate, figures, fleet
from flex_plant_sim.arm.robot_file import load_robot, robot_text
from flex_plant_sim.logs.bag_log import write_bag
from flex_plant_sim.logs.read import read_log
from flex_plant_sim.tools import replay, robot

LOG = ('{log}', '--robot', '{robot}')
# By tool and option: the tool's main, its arguments, the option, and the suffix of the file.
OUTPUTS = {
    'flex_replay --json': (replay.main, LOG, '--json', '.json'),
    'flex_replay --plot': (replay.main, LOG, '--plot', '.png'),
    'flex_replay BAG --json': (replay.main, ('{bag}', '--robot', '{robot}'), '--json', '.json'),
    'flex_estimate --json': (estimate.main, LOG, '--json', '.json'),
    'flex_diagnose --json': (diagnose.main, (*LOG, '--jobs', '1'), '--json', '.json'),
    'flex_diagnose --extended': (diagnose.main, (*LOG, '--jobs', '1'), '--extended', '.yaml'),
    'flex_diagnose --report': (diagnose.main, (*LOG, '--jobs', '1'), '--report', ''),
    'flex_robot template': (robot.main, ('template',), '--output', '.yaml'),
    'flex_robot reference': (robot.main, ('reference',), '--output', '.md'),
    'flex_robot check': (robot.main, ('check', '{robot}'), '--json', '.json'),
    'flex_robot show': (robot.main, ('show', '{robot}'), '--output', '.png'),
    'flex_robot move': (robot.main, ('move', '{robot}', '--strokes', '2'), '--output', '.csv'),
    'flex_robot urdf': (robot.main, ('urdf', '{robot}'), '--output', '.urdf'),
    'flex_robot calibrate': (robot.main, ('calibrate', *LOG, '--payload', '0.1'), '--output',
                             '.yaml'),
    'flex_demo --out': (demo.main, ('--duration', '0.1', '--robot', '{robot}'), '--out', ''),
    'flex_figures --out': (figures.main, (), '--out', ''),
    'flex_fleet --out': (fleet.main, ('{night}', '--workers', '1'), '--out', '')}
INPUTS = ('night/log.csv', 'arm.yaml', 'hard.csv', 'soft.csv', 'bag', 'bag/metadata.yaml', 'night')
FOREIGN = ('own.json', 'soft.json', 'own', 'absent/new', '/dev/full', '/dev/stdout')
# What the tools write into a folder, here the user's.
NAMES = ('summary.json', 'thesis.txt', 'report.html', 'figure_13.png', 'fleet.csv', 'robot.yaml')
# Targets that a tool may write to, because its user asks for that: new folders, or folders that
# get one more file.
HARMLESS = {'flex_figures --out': ('absent/new', 'bag', 'night'),
            'flex_fleet --out': ('absent/new',), 'flex_diagnose --report': ('bag', 'night')}
# Room that is left on a disk that fills, beyond what a tool tries first, kB.
MARGIN = 8
CLONE_NEWNS = 0x20000


def lay_out(place: Path) -> None:
    """Make a log, a bag, a robot file, and a user's own files and folders."""
    write_log(place / 'night' / 'log.csv', 1, 21.0)
    write_bag(place / 'bag', read_log(place / 'night' / 'log.csv', load_robot('reference')))
    (place / 'arm.yaml').write_text(robot_text('reference'))
    for folder in (place, place / 'own'):
        folder.mkdir(exist_ok=True)
        for name in (*NAMES, 'own.json'):
            (folder / name).write_text('{"years": "of work"}')
    os.link(place / 'night' / 'log.csv', place / 'hard.csv')
    os.symlink(place / 'night' / 'log.csv', place / 'soft.csv')
    os.symlink(place / 'own.json', place / 'soft.json')


def disks(place: Path) -> list[str]:
    """Mount a full disk, one that fills, and a read-only one; none where that is not allowed."""
    if ctypes.CDLL(None, use_errno=True).unshare(CLONE_NEWNS):
        return []
    try:
        mount('--make-rprivate', '/')
        for name, size in (('full', 64), ('fills', 64), ('fixed', 64)):
            (place / name).mkdir()
            mount('-t', 'tmpfs', '-o', f'size={size}k', name, str(place / name))
            (place / name / 'own.json').write_text('{"years": "of work"}')
        fill(place / 'full', 0)
        fill(place / 'fills', MARGIN)
        mount('-o', 'remount,ro', str(place / 'fixed'))
    except (OSError, subprocess.CalledProcessError):
        return []
    return ['full/own.json', 'full/new', 'fixed/own.json', 'fixed/new']


def mount(*words: str) -> None:
    """Mount."""
    subprocess.run(['mount', *words], check=True, capture_output=True)


def fill(disk: Path, left: int) -> None:
    """Fill a disk up to so many kB."""
    state = os.statvfs(disk)
    free = state.f_bavail * state.f_frsize // 1024
    (disk / 'ballast').write_bytes(bytes(1024 * (free - left)))


def contents(place: Path) -> dict[str, bytes]:
    """Return a digest of every file."""
    return {str(path): hashlib.sha256(path.read_bytes()).digest()
            for path in place.rglob('*') if path.is_file()}


def call(main: Callable[[list[str]], int], words: list[str]) -> tuple[int, str]:
    """Run a tool in this process; return its exit code and what it says on stderr."""
    error = io.StringIO()
    with redirect_stdout(io.StringIO()), redirect_stderr(error):
        try:
            code = main(words)
        except SystemExit as end:
            code = int(end.code or 0)
    return code, error.getvalue()


def cases(place: Path, there: list[str]) -> Iterator[tuple[str, str]]:
    """Yield every output with every target; new names get the suffix that the tool asks for."""
    for name, (_, _, _, suffix) in OUTPUTS.items():
        targets = [*INPUTS, *FOREIGN, *there, *(['fills/new'] if there else [])]
        for target in targets:
            if target not in HARMLESS.get(name, ()):
                new = target.endswith('/new')
                yield name, str(place / target) + (suffix if new else '')


def strike(name: str, target: str, place: Path) -> Counter[str]:
    """Point an output at a target; return the faults of the outcome."""
    main, words, option, _ = OUTPUTS[name]
    names = {'log': place / 'night' / 'log.csv', 'bag': place / 'bag', 'robot': place / 'arm.yaml',
             'night': place / 'night'}
    before = contents(place)
    code, error = call(main, [*(word.format(**names) for word in words), option, target])
    after = contents(place)
    lost = sum(after.get(path) != digest for path, digest in before.items())
    new = sorted(set(after) - set(before))
    fills = '/fills/' in target
    half = len([path for path in new if '/.' in path]) if fills else len(new)
    line = code in (2, 75) and error.rstrip().rpartition('\n')[2].startswith('error: ')
    bad = Counter(lost=lost, half=half, traceback=int('Traceback' in error),
                  other=int(not line and not (fills and code == 0)))
    if bad.total():
        print(f'{name} {target}: {dict(bad)} exit {code}: {error[-300:]} {new}', flush=True)
    for path in new:
        Path(path).unlink()
    return bad


def main() -> int:
    """Run every case, count, and print."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument('--page', action='store_true', help='write it into docs/faults.md')
    chosen = options.parse_args()
    bad: Counter[str] = Counter()
    with TemporaryDirectory() as name:
        place = Path(name)
        lay_out(place)
        there = disks(place)
        every = list(cases(place, there))
        for output, target in every:
            bad += strike(output, target, place)
        for disk in ('full', 'fills', 'fixed') if there else ():
            subprocess.run(['umount', place / disk], check=False)
    record('outputs', [
        f'{len(every)} runs, {len(OUTPUTS)} outputs of the tools pointed at an input, a foreign '
        'file or folder, a device' + (', a full disk, one that fills, a read-only place' if there
                                      else ' (no disks: that needs the right to mount)')
        + f': {bad["lost"]} of the user\'s files lost or changed, {bad["half"]} '
        f'half-written, {bad["traceback"]} tracebacks, {bad["other"]} not refused in one line.'],
           chosen.page)
    return min(bad.total(), 1)


if __name__ == '__main__':
    sys.exit(main())
