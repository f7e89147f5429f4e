"""
Faults between real processes, with bounds on joints, commands, payload and diagnostics.

`python test/faults/processes.py [FAULT ...] [--times N] [--page]` runs them; without names, all.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
import os
import signal
import subprocess
import sys
import time
from typing import Any

from faults.local_context import local_context
from faults.page import record
from msg_config.ros import create_sourced_subscription
import numpy as np
from ros_loop import RosLoop

PROGRAMS = {
    'plant_sim': ('flex_plant_sim.nodes.start',),
    'payload_estimator': ('flex_payload_estimator.nodes.start', 'payload_estimator'),
    'lqg_controller': ('flex_payload_estimator.nodes.start', 'lqg_controller')}
COMMON = {'modes': 2}
# The set-points go to 0.5 rad, with some overshoot; a command of 5 that is held until the drives'
# watchdog ends it, 0.1 s, moves a joint by another 0.5 rad.
LARGEST_ANGLE, COMMAND_LIMIT = 1.25, 5.0
# Motion after which the payload must be right, s: to three standard deviations and this share.
MOTION, SHARE = 3.0, 0.05
# Time within which a fault must be on diagnostics, s.
SAID = 1.0
# Time without a text on diagnostics after which it is over, s; they come once a second.
CALM = 1.5
# Longest start of the loop, s.
START = 60.0


@dataclass(frozen=True)
class Figures:
    """
    The outcome of one fault.

    Attributes
    ----------
    fault : str
    angle, command : float
        The largest, rad and the drives' own unit.
    told : float
        Time until it was on diagnostics, s; 0 where nothing has to be said.
    error : float
        Error of the payload after MOTION, as a share of the allowed one.
    broken : str
        The bound that was broken; empty if none.

    """

    fault: str
    angle: float = 0.0
    command: float = 0.0
    told: float = 0.0
    error: float = 0.0
    broken: str = ''


class Arena:
    """Three processes in real time, and an observer that watches the bounds all the time."""

    def __init__(self, context: Any, domain: int, said_within: float = SAID):
        self.loop, self.domain, self.said_within = RosLoop(context), domain, said_within
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self.joints: list[Any] = []
        self.arm: bytes | None = None
        self.second: float | None = None
        create_sourced_subscription(self.loop.observer, 'joint_states', self._watch)
        self.commands = self.loop.record('command')
        self.payload = self.loop.record('payload_stamped')
        self.diagnostics = self.loop.record('/diagnostics')
        self.mass, self.told = 0.1, 0.0

    def _watch(self, message: Any, gid: bytes | None, _: float) -> None:
        """Keep the motion of this loop's arm, and not that of a second one."""
        self.arm = self.arm or gid
        if gid == self.arm:
            self.joints.append(message)
        elif self.second is None:
            self.second = time.monotonic()

    def start(self, node: str, **values: Any) -> None:
        """Start a node as a process."""
        own: dict[str, Any] = {**COMMON, **values}
        if node == 'plant_sim':
            own = {'mode': 'realtime', 'payload': self.mass, **own}
            self.arm = None if own['payload'] == self.mass else self.arm
        arguments = [word for name, value in own.items() for word in ('-p', f'{name}:={value}')]
        self.processes[node] = subprocess.Popen(
            [sys.executable, '-m', *PROGRAMS[node], '--ros-args', *arguments],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            env={**os.environ, 'ROS_DOMAIN_ID': str(self.domain)})

    def start_all(self) -> None:
        """Start the loop and wait until it is closed and the payload is right."""
        for node in PROGRAMS:
            self.start(node)
        self.loop.until(lambda: len(self.commands) > 50, START)
        self.right_within(START)

    def signal(self, node: str, number: signal.Signals) -> None:
        """Send a signal to a node's process."""
        self.processes[node].send_signal(number)

    def error(self) -> float:
        """Return the payload's error as a share of the allowed one."""
        if not self.payload:
            return float('inf')
        last = self.payload[-1]
        allowed = 3.0 * np.sqrt(last.effort[0]) + SHARE * self.mass
        return float(abs(last.position[0] - self.mass) / allowed)

    def right_within(self, timeout: float) -> float:
        """Wait until new estimates come and are right; return how long that took, s."""
        begin, seen = time.monotonic(), len(self.payload)
        self.loop.until(lambda: len(self.payload) > seen + 50 and self.error() < 1.0, timeout)
        return time.monotonic() - begin

    def expect_right_again(self) -> None:
        """Wait for new estimates and MOTION more; fail unless the payload is right then."""
        seen = len(self.payload)
        self.loop.until(lambda: len(self.payload) > seen, START)
        self.loop.wait(MOTION)
        assert self.error() < 1.0, f'{self.payload[-1].position[0]:.4f} for {self.mass} kg'

    def said(self, text: str, since: float) -> float:
        """Wait for a text on diagnostics; return the time since `since`, s."""
        start = len(self.diagnostics)

        def found() -> bool:
            return any(text in status.message for message in self.diagnostics[start:]
                       for status in message.status)
        self.loop.until(found, 10.0)
        self.told = time.monotonic() - since
        return self.told

    def calm(self, text: str) -> None:
        """Wait until diagnostics do not hold a text any more, as on a busy machine they may."""
        for _ in range(round(START / CALM)):
            start = len(self.diagnostics)
            self.loop.wait(CALM)
            if not any(text in status.message for message in self.diagnostics[start:]
                       for status in message.status):
                return
        raise AssertionError(f'it is said all the time: {text}')

    def figures(self, fault: str) -> Figures:
        """Return the figures since the last time, and the first bound that they break."""
        angle = max(float(np.abs(message.position).max()) for message in self.joints)
        command = max(float(np.abs(message.effort).max()) for message in self.commands)
        finite = all(np.isfinite(message.position[0]) for message in self.payload)
        bounds = {f'it was said after {self.told:.2f} s': self.told <= self.said_within,
                  f'a joint went to {angle:.3g} rad': angle < LARGEST_ANGLE,
                  f'a command of {command:.3g}': command <= COMMAND_LIMIT,
                  'a payload that is no number': finite}
        broken = next((text for text, holds in bounds.items() if not holds), '')
        return Figures(fault, angle, command, self.told, self.error(), broken)

    def forget(self) -> None:
        """Begin the next fault."""
        self.joints.clear()
        self.commands.clear()
        self.told = 0.0

    def close(self) -> None:
        """End everything."""
        for process in self.processes.values():
            process.send_signal(signal.SIGCONT)
            process.kill()
            process.wait()
        self.loop.close()


def killed(node: str, text: str, **values: Any) -> Callable[[Arena], None]:
    """Return the fault of a node that is killed and started again."""
    def fault(arena: Arena) -> None:
        arena.calm(text)
        begin = time.monotonic()
        arena.signal(node, signal.SIGKILL)
        try:
            arena.said(text, begin)
        finally:
            arena.mass = values.get('payload', arena.mass)
            arena.start(node, **values)
        arena.expect_right_again()
    return fault


def stopped(node: str, text: str) -> Callable[[Arena], None]:
    """Return the fault of a node that stands still for two seconds."""
    def fault(arena: Arena) -> None:
        arena.calm(text)
        begin = time.monotonic()
        arena.signal(node, signal.SIGSTOP)
        try:
            arena.said(text, begin)
            arena.loop.wait(max(0.0, 2.0 - (time.monotonic() - begin)))
        finally:
            arena.signal(node, signal.SIGCONT)
        arena.expect_right_again()
    return fault


def second_plant(arena: Arena) -> None:
    """Let a second arm with another payload publish on the same topics."""
    before, arena.second = arena.processes['plant_sim'], None
    arena.start('plant_sim', payload=0.6)
    second, arena.processes['plant_sim'] = arena.processes['plant_sim'], before
    try:
        arena.loop.until(lambda: arena.second is not None, START)
        arena.said('publishers of', arena.second or 0.0)
        arena.expect_right_again()
    finally:
        second.kill()
        second.wait()


def clock_back(arena: Arena) -> None:
    """Let the plant begin again: in real time a new stamp, and the arm back at rest."""
    assert arena.loop.call('plant_sim', 'reset').success
    arena.expect_right_again()


NO_SAMPLE, NO_PAYLOAD = 'no message on', 'payload/inertia is late or missing'
FAULTS: dict[str, Callable[[Arena], None]] = {
    'estimator killed': killed('payload_estimator', NO_PAYLOAD),
    'controller killed': killed('lqg_controller', 'no command for the sample'),
    'plant killed, another payload': killed('plant_sim', NO_SAMPLE, payload=0.25),
    'estimator stopped': stopped('payload_estimator', NO_PAYLOAD),
    'controller stopped': stopped('lqg_controller', 'no command for the sample'),
    'plant stopped': stopped('plant_sim', NO_SAMPLE),
    'second plant': second_plant, 'clock back': clock_back}


def run(names: list[str], context: Any, domain: int, said_within: float = SAID
        ) -> list[Figures]:
    """Return the outcome of each fault, one after another in one running loop."""
    arena, found = Arena(context, domain, said_within), []
    try:
        arena.start_all()
        for name in names:
            arena.forget()
            try:
                FAULTS[name](arena)
                found.append(arena.figures(name))
            except AssertionError as error:
                found.append(Figures(name, told=arena.told, broken=str(error)))
            print(found[-1], flush=True)
    finally:
        arena.close()
    return found


def table(found: list[Figures]) -> list[str]:
    """Return the worst figures of each fault as a table."""
    lines = ['| fault | times | largest angle, rad | largest command | said after, s | '
             'payload off / allowed | bounds broken |', '|---|---|---|---|---|---|---|']
    for name in dict.fromkeys(item.fault for item in found):
        own = [item for item in found if item.fault == name]
        worst = [max(getattr(item, key) for item in own)
                 for key in ('angle', 'command', 'told', 'error')]
        broken = [item.broken for item in own if item.broken]
        lines.append(f'| {name} | {len(own)} | {worst[0]:.2f} | {worst[1]:.2f} | '
                     f'{worst[2] and format(worst[2], ".2f") or "–"} | {worst[3]:.2f} | '
                     f'{len(broken)}{": " if broken else ""}{"; ".join(broken)} |')
    return lines


def main() -> int:
    """Run the faults so many times; return 1 where a bound was broken."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument('faults', nargs='*', metavar='FAULT', help=', '.join(FAULTS))
    options.add_argument('--times', type=int, default=1)
    options.add_argument('--domain', type=int, default=92)
    options.add_argument('--page', action='store_true', help='write it into docs/faults.md')
    chosen = options.parse_args()
    context = local_context(chosen.domain)
    found = run((chosen.faults or list(FAULTS)) * chosen.times, context, chosen.domain)
    failed = sum(bool(item.broken) for item in found)
    record('processes', [*table(found), '', f'{failed} of {len(found)} broke a bound.'],
           chosen.page)
    return min(failed, 1)


if __name__ == '__main__':
    sys.exit(main())
