"""
The loop for hours: processor, memory, latency and loss over time, in real time and in lock-step.

`python test/faults/soak.py [--minutes 60] [--rate 1000] [--modes realtime lockstep bare]
[--picture FILE] [--page]` runs the three nodes as processes, in each mode for an
equal part of the time, and prints for each node the slope of its resident memory after the
warm-up; the observer counts what was lost. In mode `bare` they are nodes on the same topics that
compute nothing, so that what rclpy and DDS take of the processor is known.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
import os
from pathlib import Path
import signal
import subprocess
import sys
from tempfile import TemporaryDirectory
import time
from typing import Any

from faults.bare_nodes import STAMP
from faults.page import record
from matplotlib.figure import Figure
from msg_config.ros import create_subscription
from msg_config.time_stamp import NANOSECONDS
from msg_config.transport import avoid_shared_memory
import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

PROGRAMS = {
    'plant_sim': ('flex_plant_sim.nodes.start',),
    'payload_estimator': ('flex_payload_estimator.nodes.start', 'payload_estimator'),
    'lqg_controller': ('flex_payload_estimator.nodes.start', 'lqg_controller')}
TOPICS = ('joint_states', 'payload/inertia', 'command')
MODES = ('realtime', 'lockstep', 'bare')
HEADER = ('| mode | min | samples due | came | without a payload | without a command | '
          'p50, ms | p99, ms | memory of ' + ', '.join(PROGRAMS)
          + ', MB/h | processor of these and the observer, µs a sample '
          '| pages fetched from the disk '
          '| taken by other machines on the host, % |', '|' + 12 * '---|')
PICTURE = ('', '![Memory, latency and loss over time](figures/soak.png)')
# Time between two rows, s.
INTERVAL = 5.0
# Time between two looks of the observer, s: a fifth of what a subscription holds at 1 kHz.
LOOK = 0.02
# Fewest rows for a slope.
FEWEST = 3
# Warm-up: the estimator keeps 10 to 20 s of samples, and caches of payloads and messages fill.
WARM_UP_SHARE, WARM_UP_DATA = 0.25, 30.0
PAGE, TICKS = os.sysconf('SC_PAGE_SIZE'), os.sysconf('SC_CLK_TCK')
OBSERVER = 'observer'
# Characters that are shown of what a node said before it ended.
MOST_SAID = 4000


class Ended(Exception):
    """A node has ended that was not stopped; the argument is its name."""


@dataclass
class Heard:
    """What came on the topics since the last look: arrivals by stamp, ns, and delays, s."""

    counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(TOPICS, 0))
    last: dict[str, bytes] = field(default_factory=dict)
    arrived: dict[bytes, int] = field(default_factory=dict)
    delays: list[float] = field(default_factory=list)

    def take(self, topic: str, stamp: bytes, arrived: int) -> None:
        """Note a message; a command's delay counts from the joint_states that it answers."""
        if self.last.get(topic) == stamp:
            return  # In lock-step a sample goes out again while no command has come.
        self.last[topic] = stamp
        self.counts[topic] += 1
        if topic == 'joint_states':
            self.arrived[stamp] = arrived
            if len(self.arrived) > 1000:
                del self.arrived[next(iter(self.arrived))]
        elif topic == 'command' and stamp in self.arrived:
            self.delays.append((arrived - self.arrived.pop(stamp)) / NANOSECONDS)


def resident(pid: int) -> float:
    """Return the resident memory of a process, MB."""
    return int(Path(f'/proc/{pid}/statm').read_text().split()[1]) * PAGE / 1e6


def used(pid: int) -> tuple[float, float]:
    """Return a process's processor time, s, and how often it waited for a page from the disk."""
    own = [float(word) for word in
           Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[1:]]
    return (own[10] + own[11]) / TICKS, own[8]


def stolen() -> tuple[float, float]:
    """Return the time in which the host ran other machines, and all time, of all cores, s."""
    times = [int(word) / TICKS for word in Path('/proc/stat').read_text().split()[1:9]]
    return times[7], sum(times)


def start(mode: str, rate: float, domain: int, folder: Path
          ) -> dict[str, subprocess.Popen[bytes]]:
    """Start the three nodes; what they say goes to files of their names."""
    return {node: subprocess.Popen(
        [sys.executable, '-m', *(bare_words(node, rate) if mode == 'bare'
                                 else words(node, mode, rate))],
        stdout=subprocess.DEVNULL, stderr=(folder / node).open('wb'),
        env={**os.environ, 'ROS_DOMAIN_ID': str(domain)}) for node in PROGRAMS}


def words(node: str, mode: str, rate: float) -> list[str]:
    """Return the command line of a node."""
    own = [f'sample_time:={1.0 / rate}', 'modes:=2']
    if node == 'plant_sim':
        own.append(f'mode:={mode}')
    return [*PROGRAMS[node], '--ros-args', *(word for text in own for word in ('-p', text))]


def bare_words(node: str, rate: float) -> list[str]:
    """Return the command line of a node that computes nothing."""
    return ['faults.bare_nodes', node, '--rate', str(rate)]


class Observer:
    """
    Takes the messages on the topics, all that have come at every look.

    Being woken by each message, as a node is, would take a tenth of two cores.
    """

    def __init__(self) -> None:
        self._node, self.heard = Node('soak'), Heard()
        self._subscriptions = {topic: create_subscription(
            self._node, topic, lambda _: None, raw=True) for topic in TOPICS}

    def look(self, seconds: float) -> None:
        """Take what comes within a time, s."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            time.sleep(LOOK)
            for topic, subscription in self._subscriptions.items():
                self._take(topic, subscription)

    def _take(self, topic: str, subscription: Any) -> None:
        """Take all that waits on a topic; each of them begins with its stamp."""
        with subscription.handle:
            while taken := subscription.handle.take_message(subscription.msg_type, True):
                data, info = taken
                self.heard.take(topic, data[STAMP], info['received_timestamp'])

    def close(self) -> None:
        """Take the node down."""
        self._node.destroy_node()


def watch(observer: Observer, processes: dict[str, subprocess.Popen[bytes]], minutes: float,
          ) -> list[dict[str, float]]:
    """Return a row every INTERVAL until the end or Ctrl-C: time, memory, latency, messages."""
    rows: list[dict[str, float]] = []
    heard, begin = observer.heard, time.monotonic()
    while time.monotonic() - begin < 60.0 * minutes:
        try:
            observer.look(INTERVAL)
        except KeyboardInterrupt:
            break
        ended = [name for name, process in processes.items() if process.poll() is not None]
        if ended:
            raise Ended(ended[0])
        delays, heard.delays = heard.delays or [float('nan')], []
        row = {'time': (time.monotonic() - begin) / 60.0,
               'p50': 1e3 * float(np.quantile(delays, 0.5)),
               'p99': 1e3 * float(np.quantile(delays, 0.99))}
        row |= {name: resident(process.pid) for name, process in processes.items()}
        row |= {topic: float(count) for topic, count in heard.counts.items()}
        for name, pid in (*((name, process.pid) for name, process in processes.items()),
                          (OBSERVER, os.getpid())):
            row[f'processor of {name}'], row[f'pages of {name}'] = used(pid)
        row['stolen'], row['all time'] = stolen()
        rows.append(row)
    return rows


def run(mode: str, options: argparse.Namespace) -> list[dict[str, float]]:
    """Run one mode and return its rows."""
    observer, said = Observer(), TemporaryDirectory()
    processes = start(mode, options.rate, options.domain, Path(said.name))
    try:
        while not observer.heard.counts['command']:
            observer.look(0.5)
        observer.heard.counts.update(dict.fromkeys(TOPICS, 0))
        return watch(observer, processes, options.minutes / len(options.modes))
    except Ended as error:
        name = str(error)
        last = (Path(said.name) / name).read_text(errors='replace')[-MOST_SAID:]
        raise SystemExit(f'{mode}: {name} ended with {processes[name].poll()}:\n{last}') from None
    finally:
        for process in processes.values():
            process.send_signal(signal.SIGTERM)
            process.wait()
        observer.close()
        said.cleanup()


def warm(rows: list[dict[str, float]], rate: float) -> list[dict[str, float]]:
    """Return the rows after the warm-up."""
    first = next((k for k, row in enumerate(rows)
                  if row['joint_states'] > WARM_UP_DATA * rate), len(rows))
    return rows[max(int(WARM_UP_SHARE * len(rows)), min(first, len(rows) - FEWEST)):]


def verdict(mode: str, rows: list[dict[str, float]], rate: float) -> str:
    """Return a row of the table, after the warm-up: what was lost, latency, memory's slope."""
    late = warm(rows, rate)
    hours = np.array([row['time'] for row in late]) / 60.0
    slopes = [np.polyfit(hours, [row[name] for row in late], 1)[0] for name in PROGRAMS]
    counts = {topic: rows[-1][topic] - late[0][topic] for topic in TOPICS}
    minutes = rows[-1]['time'] - late[0]['time']
    due = '–' if mode == 'lockstep' else f'{rate * 60.0 * minutes:.0f}'
    spent = [1e6 * (rows[-1][f'processor of {name}'] - late[0][f'processor of {name}'])
             / counts['joint_states'] for name in (*PROGRAMS, OBSERVER)]
    taken = (rows[-1]['stolen'] - late[0]['stolen']) / (rows[-1]['all time'] - late[0]['all time'])
    pages = [rows[-1][f'pages of {name}'] - late[0][f'pages of {name}'] for name in PROGRAMS]
    lost = [f'{counts["joint_states"] - counts[topic]:.0f}' for topic in TOPICS[1:]]
    delays = [f'{np.nanmedian([row[name] for row in late]):.2f}' for name in ('p50', 'p99')]
    return ' | '.join([f'| {mode}', f'{minutes:.1f}', due, f'{counts["joint_states"]:.0f}',
                       *lost, *delays, ', '.join(f'{slope:+.2f}' for slope in slopes),
                       ' + '.join(f'{each:.0f}' for each in spent) + f' = {sum(spent):.0f}',
                       ', '.join(f'{each:.0f}' for each in pages),
                       f'{100.0 * taken:.1f} |'])


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
            missing = [row['joint_states'] - row[topic] for row in rows]
            # What came before the first answer is no loss.
            column[2].plot(minutes, [count - missing[0] for count in missing],
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
    """Run the modes, print a line for each, and draw if asked."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument('--minutes', type=float, default=60.0)
    options.add_argument('--rate', type=float, default=1000.0)
    options.add_argument('--domain', type=int, default=94)
    options.add_argument('--modes', nargs='+', choices=MODES, default=list(MODES))
    options.add_argument('--picture', type=Path, metavar='PNG', help='where to draw it')
    options.add_argument('--page', action='store_true', help='write it into docs/faults.md')
    chosen = options.parse_args()
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    avoid_shared_memory()
    rclpy.init(domain_id=chosen.domain, signal_handler_options=SignalHandlerOptions.NO)
    found: dict[str, list[dict[str, float]]] = {}
    for mode in chosen.modes:
        try:
            rows = run(mode, chosen)
        except KeyboardInterrupt:
            break
        if len(rows) > FEWEST:
            found[mode] = rows
            if chosen.picture:
                draw(found, chosen.picture)
            record('soak', [f'At {chosen.rate:g} Hz:', '', *HEADER, *(
                verdict(name, each, chosen.rate) for name, each in found.items()),
                *PICTURE], chosen.page)
    rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
