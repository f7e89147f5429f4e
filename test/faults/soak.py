"""
The loop for hours: memory, latency and loss over time, in real time and in lock-step.

`python test/faults/soak.py [--minutes 60] [--rate 1000] [--picture FILE]` runs the three nodes as
processes, half of the time in real time at the rate, half in lock-step, and prints for each node
the slope of its resident memory after the warm-up; the observer counts what was lost.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

from matplotlib.figure import Figure
from msg_config.messages import stamp_of
from msg_config.node_process import make_executor
from msg_config.ros import create_subscription
import numpy as np
import rclpy
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.node import Node
from rclpy.task import Future

PROGRAMS = {
    'plant_sim': ('flex_plant_sim.nodes.start',),
    'payload_estimator': ('flex_payload_estimator.nodes.start', 'payload_estimator'),
    'lqg_controller': ('flex_payload_estimator.nodes.start', 'lqg_controller')}
TOPICS = ('joint_states', 'payload/inertia', 'command')
INTERVAL = 5.0
# A slope needs some rows.
FEWEST = 3
# Share of a run that is warm-up: caches of payloads and of messages fill.
WARM_UP = 0.25
PAGE = os.sysconf('SC_PAGE_SIZE')


@dataclass
class Heard:
    """What came on the topics since the last look: arrivals by stamp, and delays, s."""

    counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(TOPICS, 0))
    arrived: dict[int, float] = field(default_factory=dict)
    delays: list[float] = field(default_factory=list)

    def take(self, topic: str, message: Any) -> None:
        """Note a message; a command's delay counts from the joint_states that it answers."""
        self.counts[topic] += 1
        stamp, now = stamp_of(message), time.monotonic()
        if topic == 'joint_states':
            self.arrived[stamp] = now
            if len(self.arrived) > 1000:
                del self.arrived[next(iter(self.arrived))]
        elif topic == 'command' and stamp in self.arrived:
            self.delays.append(now - self.arrived.pop(stamp))


def resident(pid: int) -> float:
    """Return the resident memory of a process, MB."""
    return int(Path(f'/proc/{pid}/statm').read_text().split()[1]) * PAGE / 1e6


def start(mode: str, rate: float, domain: int) -> dict[str, subprocess.Popen[bytes]]:
    """Start the three nodes."""
    own = {'plant_sim': (f'mode:={mode}',), 'payload_estimator': (), 'lqg_controller': ()}
    return {node: subprocess.Popen(
        [sys.executable, '-m', *program, '--ros-args', '-p', f'sample_time:={1.0 / rate}',
         '-p', 'modes:=2', *(word for text in own[node] for word in ('-p', text))],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        env={**os.environ, 'ROS_DOMAIN_ID': str(domain)})
        for node, program in PROGRAMS.items()}


def watch(executor: Executor, heard: Heard, processes: dict[str, subprocess.Popen[bytes]],
          minutes: float) -> list[dict[str, float]]:
    """Return a row every INTERVAL until the end or Ctrl-C: time, memory, latency, messages."""
    rows: list[dict[str, float]] = []
    begin = time.monotonic()
    while time.monotonic() - begin < 60.0 * minutes:
        try:
            executor.spin_until_future_complete(Future(), timeout_sec=INTERVAL)
        except (KeyboardInterrupt, ExternalShutdownException):
            break
        delays, heard.delays = heard.delays or [float('nan')], []
        row = {'time': (time.monotonic() - begin) / 60.0,
               'p50': 1e3 * float(np.quantile(delays, 0.5)),
               'p99': 1e3 * float(np.quantile(delays, 0.99))}
        row |= {name: resident(process.pid) for name, process in processes.items()}
        row |= {topic: float(count) for topic, count in heard.counts.items()}
        rows.append(row)
    return rows


def run(mode: str, options: argparse.Namespace) -> list[dict[str, float]]:
    """Run one mode and return its rows."""
    node, executor, heard = Node('soak'), make_executor(), Heard()
    executor.add_node(node)
    for topic in TOPICS:
        create_subscription(node, topic, lambda message, name=topic: heard.take(name, message))
    processes = start(mode, options.rate, options.domain)
    try:
        while not heard.counts['command']:
            executor.spin_until_future_complete(Future(), timeout_sec=0.5)
        heard.counts.update(dict.fromkeys(TOPICS, 0))
        return watch(executor, heard, processes, 0.5 * options.minutes)
    finally:
        for process in processes.values():
            process.send_signal(signal.SIGTERM)
            process.wait()
        executor.remove_node(node)
        node.destroy_node()


def verdict(mode: str, rows: list[dict[str, float]], rate: float) -> str:
    """Return one line a mode, after the warm-up: what was lost, latency, memory's slope."""
    late = rows[int(WARM_UP * len(rows)):]
    hours = np.array([row['time'] for row in late]) / 60.0
    slopes = {name: np.polyfit(hours, [row[name] for row in late], 1)[0] for name in PROGRAMS}
    counts = {topic: rows[-1][topic] - late[0][topic] for topic in TOPICS}
    minutes = rows[-1]['time'] - late[0]['time']
    memory = ', '.join(f'{name} {slope:+.2f}' for name, slope in slopes.items())
    asked = f' of {rate * 60.0 * minutes:.0f} due' if mode == 'realtime' else ''
    return (f'{mode}: {counts["joint_states"]:.0f} samples{asked}, '
            f'{counts["joint_states"] - counts["payload/inertia"]:.0f} without an estimate, '
            f'{counts["joint_states"] - counts["command"]:.0f} without a command; latency p50 '
            f'{np.nanmedian([row["p50"] for row in late]):.2f}, p99 '
            f'{np.nanmedian([row["p99"] for row in late]):.2f} ms; memory MB/h: {memory}')


def draw(found: dict[str, list[dict[str, float]]], path: Path) -> None:
    """Draw memory, latency and loss over time."""
    figure = Figure(figsize=(10.0, 7.0), layout='constrained')
    axes = figure.subplots(3, len(found), squeeze=False, sharex='col')
    for column, (mode, rows) in zip(axes.T, found.items()):
        minutes = [row['time'] for row in rows]
        for name in PROGRAMS:
            column[0].plot(minutes, [row[name] for row in rows], label=name)
        for name in ('p50', 'p99'):
            column[1].plot(minutes, [row[name] for row in rows], label=name)
        for topic in TOPICS[1:]:
            column[2].plot(minutes, [row['joint_states'] - row[topic] for row in rows],
                           label=f'without {topic}')
        column[0].set_title(mode)
        for axis, text in zip(column, ('resident memory, MB', 'sample to command, ms',
                                       'samples')):
            axis.set_ylabel(text)
            axis.legend(fontsize='small')
        column[1].set_yscale('log')
        column[2].set_xlabel('minutes')
    figure.savefig(path, dpi=120)


def main() -> int:
    """Run both modes, print a line each, and draw."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument('--minutes', type=float, default=60.0)
    options.add_argument('--rate', type=float, default=1000.0)
    options.add_argument('--domain', type=int, default=94)
    options.add_argument('--picture', type=Path, default=Path('docs/figures/soak.png'))
    chosen = options.parse_args()
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    rclpy.init(domain_id=chosen.domain)
    found: dict[str, list[dict[str, float]]] = {}
    for mode in ('realtime', 'lockstep'):
        try:
            rows = run(mode, chosen)
        except (KeyboardInterrupt, ExternalShutdownException):
            break
        if len(rows) > FEWEST:
            found[mode] = rows
            print(verdict(mode, rows, chosen.rate), flush=True)
            draw(found, chosen.picture)
    rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
