"""
Measure the estimator node's latency, strain in to payload out, beside a bare rclpy echo node.

This process makes samples at a fixed rate, sends a command after every answer as a controller
does, and takes the time. The other process is payload_estimator, or a node that only sends strain
back. Blocks of both alternate in one run, so that both see the same machine.
"""

from __future__ import annotations

import argparse
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
import gc
import json
import os
import signal
import subprocess
import sys
import time
from typing import Any

from flex_plant_sim.simulation.plant_setup import simulator_of
from geometry_msgs.msg import InertiaStamped
from msg_config.input_mapping import JOINTS
from msg_config.messages import (
    doubles,
    joint_state,
    nanoseconds,
    stamp_of,
    time_message,
)
from msg_config.parameters import check_parameters
from msg_config.ros import create_publisher
from msg_config.transport import avoid_shared_memory
import numpy as np
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

# Percentile of the latency to the largest ratio that is asked for, estimator over echo.
TARGETS = {50: 1.2, 99: 1.5}
# Begin of a block that is left out, s.
WARM_UP = 1.0
# Time for the estimator to catch up after its start, s.
SETTLING = 3.0
# Longest wait for an answering node, s.
PATIENCE = 30.0
ECHO = 'echo/strain'
# Messages that a queue holds.
DEPTH = 1000
# Answers after which a node counts as started.
ANSWERS_TO_START = 20


def echo() -> None:
    """Run the bare node, which sends each strain message out again on another topic."""
    rclpy.init()
    node = Node('echo')
    publisher = node.create_publisher(JointState, ECHO, 10)
    node.create_subscription(JointState, 'strain', publisher.publish, 10)
    executor = EventsExecutor()
    executor.add_node(node)
    try:
        executor.spin_until_future_complete(Future(), timeout_sec=1e6)
    except KeyboardInterrupt:
        pass


class Samples:
    """Simulated measurements of an arm that moves as in the paper's experiment."""

    def __init__(self, rate: float, seconds: float, arm: dict[str, Any]):
        values = check_parameters('plant_sim', {**arm, 'sample_time': 1.0 / rate})
        simulator = simulator_of(values)
        self.rows: list[tuple[Any, ...]] = []
        for k in range(round(seconds * rate)):
            sample = simulator.measure()
            self.rows.append(tuple(map(doubles, (sample.angle, sample.strain, sample.command))))
            wanted = 0.5 if (k // round(2.0 * rate)) % 2 == 0 else -0.5
            simulator.step(np.clip(3.0 * (wanted - sample.angle), -2.0, 2.0))
        # Built once and filled at every sample, so that this process takes little time.
        self._joint_states, self._command = joint_state(0, JOINTS), joint_state(0, JOINTS)
        self._strain = joint_state(0, simulator.arm.robot.gauge_names)

    def command(self, k: int, stamp: int) -> JointState:
        """Return the command applied up to sample k, as a message of a stamp, ns."""
        self._command.header.stamp = time_message(stamp)
        self._command.effort = self.rows[k][2]
        return self._command

    def messages(self, k: int, stamp: int) -> tuple[JointState, JointState]:
        """Return joint_states and strain of sample k."""
        for message in (self._joint_states, self._strain):
            message.header.stamp = time_message(stamp)
        self._joint_states.position, self._strain.position, self._joint_states.effort = \
            self.rows[k]
        return self._joint_states, self._strain


class Driver(Node):
    """Publishes samples at a rate and takes the time until the answers come."""

    def __init__(self, rate: float, samples: Samples):
        super().__init__('driver')
        self.rate, self.samples, self.k, self.first = rate, samples, 0, 0
        self._joint_states = create_publisher(self, 'joint_states')
        self._strain = create_publisher(self, 'strain')
        self._command = create_publisher(self, 'command')
        self.sent: dict[int, int] = {}
        self.payloads: deque[int] = deque()
        self.answered: dict[int, int] = {}
        self.echoed: dict[int, int] = {}
        self._end: Future[None] = Future()
        self._until = 0
        for kind, topic, callback in ((Float64MultiArray, 'payload', self._on_payload),
                                      (InertiaStamped, 'payload/inertia', self._on_inertia),
                                      (JointState, ECHO, self._on_echo)):
            self.create_subscription(kind, topic, callback, DEPTH)
        self.create_timer(1.0 / rate, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._running = False

    def forget(self) -> None:
        """Forget all times; count from the next sample on."""
        self.first = self.k
        for record in (self.sent, self.answered, self.echoed):
            record.clear()

    def run(self, executor: Any, seconds: float) -> None:
        """Send samples for a time and wait for the last answers."""
        self._end, self._until = Future(), self.k + round(seconds * self.rate)
        self._running = True
        executor.spin_until_future_complete(self._end, timeout_sec=10.0 * seconds + PATIENCE)
        self._running = False
        executor.spin_until_future_complete(Future(), timeout_sec=0.2)

    def _tick(self) -> None:
        if not self._running:
            return
        stamp = nanoseconds(self.k / self.rate)
        joint_states, strain = self.samples.messages(self.k, stamp)
        self._joint_states.publish(joint_states)
        self.sent[stamp] = time.monotonic_ns()
        self._strain.publish(strain)
        self.k += 1
        if self.k >= self._until:
            self._running = False
            self._end.set_result(None)

    def _on_payload(self, _: Any) -> None:
        self.payloads.append(time.monotonic_ns())

    def _on_inertia(self, message: Any) -> None:
        # `payload` has no stamp, but goes out just before `payload/inertia`, which has one.
        stamp = stamp_of(message)
        self.answered[stamp] = self.payloads.popleft()
        self._answer(stamp)

    def _on_echo(self, message: Any) -> None:
        stamp = stamp_of(message)
        self.echoed[stamp] = time.monotonic_ns()
        self._answer(stamp)

    def _answer(self, stamp: int) -> None:
        """Send the command that is applied from a sample on: the next sample's effort."""
        k = round(stamp * 1e-9 * self.rate)
        self._command.publish(self.samples.command(k + 1, stamp))


@contextmanager
def process(arguments: list[str]) -> Iterator[None]:
    """Run a Python process for a while."""
    child = subprocess.Popen([sys.executable, *arguments])
    try:
        yield
    finally:
        child.send_signal(signal.SIGINT)
        child.wait(timeout=20.0)


def wait_for(executor: Any, driver: Driver) -> None:
    """Send samples until all are answered: discovery takes 0.1 s to several seconds."""
    deadline = time.monotonic() + PATIENCE
    while len(driver.answered) + len(driver.echoed) < ANSWERS_TO_START:
        if time.monotonic() > deadline:
            raise SystemExit(f'no answering node within {PATIENCE:g} s')
        driver.run(executor, 0.1)
    # The estimator starts with many hypotheses; then it catches up.
    driver.run(executor, SETTLING)
    driver.run(executor, 0.1)
    driver.forget()


def latencies(driver: Driver, kind: str) -> tuple[np.ndarray, int]:
    """Return the latencies of a block, s, and how many samples were lost."""
    stamps = [nanoseconds(k / driver.rate) for k in range(driver.first, driver.k)]
    arrived = driver.echoed if kind == 'echo' else driver.answered
    times = [arrived[stamp] - driver.sent[stamp] for stamp in stamps if stamp in arrived]
    lost = len(stamps) - len(times)
    warm = round(WARM_UP * driver.rate)
    return 1e-9 * np.array(times[warm:]), lost


def block(kind: str, command: list[str], options: argparse.Namespace,
          samples: Samples) -> tuple[np.ndarray, int]:
    """Measure one node for one block."""
    with process(command):
        driver = Driver(options.rate, samples)
        executor = EventsExecutor()
        executor.add_node(driver)
        gc.collect()
        gc.freeze()
        wait_for(executor, driver)
        driver.run(executor, WARM_UP + options.duration / options.blocks)
        result = latencies(driver, kind)
        executor.remove_node(driver)
        driver.destroy_node()
        executor.shutdown()
    return result


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Return the percentiles of both nodes, their ratios and the samples lost."""
    arm = {'model': options.model, 'modes': options.modes}
    # The longest that a block may take: a jump back to the start would be a jump of the arm.
    seconds = PATIENCE + SETTLING + 2.0 * WARM_UP + options.duration / options.blocks
    samples = Samples(options.rate, seconds, arm)
    estimator = ['-m', 'flex_payload_estimator.nodes.start', 'payload_estimator', '--ros-args',
                 '-p', f'sample_time:={1.0 / options.rate}',
                 '-p', f'estimator:={options.estimator}',
                 '-p', f'model:={options.model}', '-p', f'modes:={options.modes}']
    commands = {'echo': [__file__, '--echo'], 'estimator': estimator}
    times: dict[str, list[np.ndarray]] = {kind: [] for kind in commands}
    lost = dict.fromkeys(commands, 0)
    for number in range(options.blocks):
        for kind, command in commands.items():
            values, missing = block(kind, command, options, samples)
            times[kind].append(values)
            lost[kind] += missing
            print(f'block {number + 1} of {options.blocks}, {kind:<9} '
                  + (f'p50 {1e6 * np.percentile(values, 50):7.0f} µs   p99 '
                     f'{1e6 * np.percentile(values, 99):7.0f} µs' if values.size else 'no latency')
                  + f'   lost {missing}', flush=True)
    return summary(options, {kind: np.concatenate(own) for kind, own in times.items()}, lost)


def summary(options: argparse.Namespace, times: dict[str, np.ndarray],
            lost: dict[str, int]) -> dict[str, Any]:
    """Return the figures of the whole run."""
    for kind, own in times.items():
        if not own.size:
            raise SystemExit(f'{kind}: no sample was answered')
    result: dict[str, Any] = {
        'rate_hz': options.rate, 'duration_s': options.duration, 'lost': lost,
        'estimator': options.estimator, 'model': options.model, 'modes': options.modes}
    for percent in TARGETS:
        for kind, own in times.items():
            result[f'{kind}_p{percent}_us'] = float(1e6 * np.percentile(own, percent))
        result[f'ratio_p{percent}'] = (result[f'estimator_p{percent}_us']
                                       / result[f'echo_p{percent}_us'])
    return result


def options_of() -> argparse.Namespace:
    """Return the parsed options."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument('--rate', type=float, default=1000.0, help='samples a second')
    parser.add_argument('--duration', type=float, default=12.0,
                        help='s a node, in all blocks (60 for the figure in docs)')
    parser.add_argument('--blocks', type=int, default=3, help='blocks of each node')
    parser.add_argument('--estimator', default='rpe')
    parser.add_argument('--model', default='assumed_modes')
    parser.add_argument('--modes', type=int, default=3)
    parser.add_argument('--json', help='write the figures to this file')
    parser.add_argument('--echo', action='store_true', help=argparse.SUPPRESS)
    return parser.parse_args()


def main() -> int:
    """Measure and print."""
    options = options_of()
    if options.echo:
        echo()
        return 0
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    avoid_shared_memory()
    rclpy.init(args=[])
    result = measure(options)
    rclpy.try_shutdown()
    for percent, target in TARGETS.items():
        print(f'p{percent}: echo {result[f"echo_p{percent}_us"]:.0f} µs, estimator '
              f'{result[f"estimator_p{percent}_us"]:.0f} µs, ratio '
              f'{result[f"ratio_p{percent}"]:.2f} (target {target})')
    print(f'samples lost: {result["lost"]}')
    if options.json:
        with open(options.json, 'w', encoding='utf-8') as file:
            json.dump(result, file, indent=2)
    return 0


if __name__ == '__main__':
    sys.exit(main())
