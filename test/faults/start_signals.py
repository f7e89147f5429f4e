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
# Before this, s, Python itself starts, and no line of this package has run.
OWN = 0.15
LATEST = 4.0


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
                   chance.uniform(OWN, LATEST), domain) for _ in range(count)]


def main() -> int:
    """Print what was not clean; return how many."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument('--count', type=int, default=100)
    options.add_argument('--seed', type=int, default=0)
    options.add_argument('--domain', type=int, default=90)
    chosen = options.parse_args()
    found = attacks(chosen.count, chosen.seed, chosen.domain)
    for item in found:
        if not item.clean:
            print(f'{item.node} {item.number.name} after {item.delay:.3f} s: {item.code}\n'
                  f'{item.error}')
    print(Counter((item.number.name, item.code) for item in found),
          f'{sum(not item.clean for item in found)} of {len(found)} not clean')
    return min(sum(not item.clean for item in found), 1)


if __name__ == '__main__':
    sys.exit(main())
