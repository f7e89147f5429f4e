"""
Signals during the start of a node: no traceback, and the exit codes that were promised.

`python test/faults/start_signals.py [--count N] [--seed S]` sends N signals at random moments.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import dataclass
import os
import random
import signal
import subprocess
import sys
import time

PROGRAMS = {
    'plant_sim': ('flex_plant_sim.nodes.start',),
    'payload_estimator': ('flex_payload_estimator.nodes.start', 'payload_estimator'),
    'lqg_controller': ('flex_payload_estimator.nodes.start', 'lqg_controller')}
CODES = {signal.SIGINT: (0, 130), signal.SIGTERM: (0,)}
LATEST = 4.0
# What Python says where a signal comes while it imports `site`: no line of this package has run.
SITE = 'Failed to import the site module'


@dataclass(frozen=True)
class Attack:
    """One signal: to which node, which, how late (s), and what came of it."""

    node: str
    number: signal.Signals
    delay: float
    code: int
    error: str

    @property
    def clean(self) -> bool:
        """Return whether it ended as promised."""
        return self.code in CODES[self.number] and 'Traceback' not in self.error

    @property
    def too_early(self) -> bool:
        """Return whether Python itself took it, before a line of this package had run."""
        silent = self.code == -self.number and not self.error
        return silent or SITE in self.error


def attack(node: str, number: signal.Signals, delay: float, domain: int) -> Attack:
    """Start a node, send a signal after a delay, s, and return how it ended."""
    process = subprocess.Popen(
        [sys.executable, '-m', *PROGRAMS[node]], text=True, stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE, env={**os.environ, 'ROS_DOMAIN_ID': str(domain),
                                     'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'})
    time.sleep(delay)
    process.send_signal(number)
    try:
        error = process.communicate(timeout=30.0)[1]
    except subprocess.TimeoutExpired:
        process.kill()
        error = 'hangs'
    return Attack(node, number, delay, process.returncode, error)


def attacks(count: int, seed: int, domain: int) -> list[Attack]:
    """Return what came of signals at random moments of the start."""
    chance = random.Random(seed)
    return [attack(chance.choice(sorted(PROGRAMS)), chance.choice(sorted(CODES)),
                   chance.uniform(0.0, LATEST), domain) for _ in range(count)]


def main() -> int:
    """Print what was not clean; return how many."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument('--count', type=int, default=100)
    options.add_argument('--seed', type=int, default=0)
    options.add_argument('--domain', type=int, default=90)
    chosen = options.parse_args()
    found = attacks(chosen.count, chosen.seed, chosen.domain)
    early = [item for item in found if item.too_early]
    bad = [item for item in found if not (item.clean or item.too_early)]
    for item in bad:
        print(f'{item.node} {item.number.name} after {item.delay:.3f} s: {item.code}\n'
              f'{item.error}')
    print(Counter((item.number.name, item.code) for item in found))
    print(f'{len(bad)} of {len(found)} not clean; {len(early)} more ended while Python itself '
          f'started, up to {max((item.delay for item in early), default=0.0):.2f} s, '
          f'{sum(SITE in item.error for item in early)} of them with its own traceback')
    return min(len(bad), 1)


if __name__ == '__main__':
    sys.exit(main())
