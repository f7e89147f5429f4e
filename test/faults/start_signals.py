"""
Signals during the start of a node or a tool: no traceback, and the documented exit codes.

`python test/faults/start_signals.py [--count N] [--seed S] [--only NAME ...] [--page]` sends N
signals at random moments, and checks that nothing goes on running or is left half-written.
"""

from __future__ import annotations

import argparse
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
import os
from pathlib import Path
import random
import signal
import subprocess
import sys
from tempfile import TemporaryDirectory
import time

import psutil

NODES = {
    'plant_sim': ('flex_plant_sim.nodes.start',),
    'payload_estimator': ('flex_payload_estimator.nodes.start', 'payload_estimator'),
    'lqg_controller': ('flex_payload_estimator.nodes.start', 'lqg_controller')}
TOOLS = ('compile', 'demo', 'diagnose', 'estimate', 'figures', 'fleet', 'replay', 'robot')
MODULES = {**dict.fromkeys(TOOLS, 'flex_payload_estimator.tools'),
           **dict.fromkeys(('replay', 'robot'), 'flex_plant_sim.tools')}
OUT = ('--out', '{out}/folder')
OPTIONS: dict[str, tuple[str, ...]] = {
    'demo': ('--duration', '1', *OUT), 'figures': OUT,
    'diagnose': ('{log}', '--jobs', '1', '--report', '{out}/folder'),
    'estimate': ('{log}', '--json', '{out}/a.json'),
    'fleet': ('{night}', '--workers', '1', *OUT),
    'replay': ('{log}', '--json', '{out}/a.json', '--plot', '{out}/a.png'),
    'robot': ('show', 'reference', '--output', '{out}/a.png')}
# Exit codes that are right; a tool or node may have ended before the signal came.
NODE_CODES = {signal.SIGINT: (0, 130), signal.SIGTERM: (0,)}
TOOL_CODES = dict.fromkeys((signal.SIGINT, signal.SIGTERM, signal.SIGHUP), (0, 130))
# Latest moment of a signal after the start, and how long children may take to end after that, s.
LATEST, LINGER = 4.0, 1.0
# Python's own messages where a signal comes while it imports `site`: no line of this package has
# run.
SITE = ('Failed to import the site module', 'Fatal Python error: init_')


@dataclass(frozen=True)
class Attack:
    """One signal: the program, the signal, its delay (s), and the outcome."""

    program: str
    number: signal.Signals
    delay: float
    code: int
    error: str

    @property
    def clean(self) -> bool:
        """Return whether the program ended as it should."""
        codes = NODE_CODES if self.program in NODES else TOOL_CODES
        return self.code in codes[self.number] and 'Traceback' not in self.error

    @property
    def too_early(self) -> bool:
        """Return whether Python itself took the signal, before a line of this package had run."""
        silent = self.code == -self.number and not self.error
        return silent or any(text in self.error for text in SITE)


def attack(program: str, number: signal.Signals, delay: float, domain: int,
           folder: Path = Path()) -> Attack:
    """Start a node, or a tool on the logs of a folder; send a signal after a delay, s."""
    process = subprocess.Popen(
        command(program, folder), text=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        start_new_session=True, env={**os.environ, 'ROS_DOMAIN_ID': str(domain),
                                     'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'})
    time.sleep(delay)
    process.send_signal(number)
    try:
        error = process.communicate(timeout=30.0)[1]
    except subprocess.TimeoutExpired:
        error = 'Traceback: it, or a child, goes on'
    if running_in(process.pid, LINGER):
        error += f'Traceback: goes on: {running_in(process.pid)}'
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    left = [path.name for path in folder.glob('out/**/.*')] if program in TOOLS else []
    return Attack(program, number, delay, process.returncode,
                  f'{error}Traceback: it left {left}' if left else error)


def running_in(session: int, patience: float = 0.0) -> list[int]:
    """Return the processes of a session that have not ended after some time, s."""
    end = time.monotonic() + patience
    while True:
        found = []
        for process in psutil.process_iter():
            with suppress(OSError, psutil.Error):
                if os.getsid(process.pid) == session and process.status() != 'zombie':
                    found.append(process.pid)
        if not found or time.monotonic() > end:
            return found
        time.sleep(0.02)


def command(program: str, folder: Path) -> list[str]:
    """Return the command line of a node or a tool, with its outputs in a new folder `out`."""
    if program in NODES:
        return [sys.executable, '-m', *NODES[program]]
    (folder / 'out').mkdir()
    names = {'log': folder / 'night' / '0.csv', 'night': folder / 'night', 'out': folder / 'out'}
    return [sys.executable, '-m', f'{MODULES[program]}.{program}',
            *(word.format(**names) for word in OPTIONS.get(program, ()))]


def attacks(count: int, seed: int, domain: int, programs: list[str]) -> list[Attack]:
    """Return the outcomes of signals at random moments of the start."""
    from faults.fleet_run import write_log

    chance, found = random.Random(seed), []
    for _ in range(count):
        with TemporaryDirectory() as name:
            write_log(Path(name) / 'night' / '0.csv', 1, 21.0)
            program = chance.choice(programs)
            codes = NODE_CODES if program in NODES else TOOL_CODES
            found.append(attack(program, chance.choice(sorted(codes)),
                                chance.uniform(0.0, LATEST), domain, Path(name)))
    return found


def main() -> int:
    """Print the attacks that were not clean; return their number."""
    from faults.page import record

    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument('--count', type=int, default=200)
    options.add_argument('--seed', type=int, default=0)
    options.add_argument('--domain', type=int, default=90)
    options.add_argument('--only', nargs='+', choices=[*NODES, *TOOLS], default=[*NODES, *TOOLS])
    options.add_argument('--page', action='store_true', help='write it into docs/faults.md')
    chosen = options.parse_args()
    # A shell lets what runs in the background ignore Ctrl-C, and children inherit that.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    found = attacks(chosen.count, chosen.seed, chosen.domain, chosen.only)
    early = [item for item in found if item.too_early]
    bad = [item for item in found if not (item.clean or item.too_early)]
    for item in bad:
        print(f'{item.program} {item.number.name} after {item.delay:.3f} s: {item.code}\n'
              f'{item.error}')
    codes = Counter((item.number.name, item.code) for item in found)
    record('signals', [
        f'{len(found)} signals to {len(chosen.only)} programs in their first {LATEST:g} s: '
        f'{sum("Traceback" in item.error for item in bad)} tracebacks, files left half-written '
        f'or processes left running, {len(bad)} not as promised. '
        + ', '.join(f'{name} → {code}: {count}' for (name, code), count in sorted(codes.items()))
        + f'. {len(early)} came while Python itself started, up to '
        f'{max((item.delay for item in early), default=0.0):.2f} s; to '
        f'{sum("Traceback" in item.error for item in early)} of them it answered with a traceback '
        'of its own, before a line of this package had run.'], chosen.page)
    return min(len(bad), 1)


if __name__ == '__main__':
    sys.exit(main())
