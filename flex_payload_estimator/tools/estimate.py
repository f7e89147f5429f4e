"""flex_estimate: estimate the payload over logs, as a table and JSON."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
import sys
from typing import Any

from flex_payload_estimator.estimators.base import Event, PayloadEstimator
from flex_payload_estimator.estimators.factory import coriolis_of, described, make_estimator
from flex_payload_estimator.estimators.rpe import compiled_step
from flex_payload_estimator.tools.words import decimals_of, with_uncertainty
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import say_if_compiling
from flex_plant_sim.interval import Z95
from flex_plant_sim.logs.log import Log
from flex_plant_sim.tools import command_line
from flex_plant_sim.tools.log_input import read_log_aloud
from flex_plant_sim.tools.outputs import check_outputs, results
from msg_config.errors import InputError
from msg_config.parameters import load_parameters
import numpy as np

# Times after a log's start at which the estimate is shown, s; two per decade.
TIMES = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
IF_TOLD = 'if every part is as the robot file says'


@dataclass(frozen=True)
class Estimates:
    """
    The estimates of one estimator over a log.

    Attributes
    ----------
    source : str
        Name of the log.
    time : Array
        Time since the log's start, s, (N,).
    mass, variance : Array
        Payload, kg, and its variance, kg^2, (N,).
    status : tuple of str
        The estimator's status, N.
    parts_as_told : tuple of bool
        Whether an estimate holds only if all parts are as the robot file says, N.
    payload_max : float
        Largest payload that was looked for, kg.
    changes : tuple of Event
        The changes of the payload that were found; times since the log's start.

    """

    source: str
    time: Array
    mass: Array
    variance: Array
    status: tuple[str, ...]
    parts_as_told: tuple[bool, ...]
    payload_max: float
    changes: tuple[Event, ...] = ()

    def row(self, index: int) -> tuple[float, float]:
        """Return payload and standard deviation at a sample, kg."""
        return float(self.mass[index]), float(np.sqrt(self.variance[index]))

    def marks(self) -> dict[str, int]:
        """Return, by the time, the last sample no later than each of TIMES inside the log."""
        return {f'{t:g}': int(np.searchsorted(self.time, t + 1e-9, side='right')) - 1
                for t in TIMES if t <= self.time[-1] + 1e-9}

    def results(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        mass, std = self.row(-1)
        counts = {name: self.status.count(name) for name in sorted(set(self.status))}
        return {
            'log': self.source, 'duration_s': round(float(self.time[-1]), 9),
            'mass_kg': mass, 'std_kg': std,
            'interval95_kg': [max(mass - Z95 * std, 0.0), mass + Z95 * std],
            'at_s': {key: self.row(k)[0] for key, k in self.marks().items()},
            'std_at_s': {key: self.row(k)[1] for key, k in self.marks().items()},
            'status': self.status[-1], 'status_samples': counts,
            'changes': [{'time_s': event.time, 'before_kg': event.before, 'after_kg': event.after}
                        for event in self.changes],
            'parts_as_told': self.parts_as_told[-1],
            'parts_as_told_at_s': {key: self.parts_as_told[k] for key, k in self.marks().items()}}

    def table(self) -> str:
        """Return the figures as a table for the terminal; a * marks what holds IF_TOLD."""
        last = len(self.time) - 1
        rows = [*((f'{key} s', k) for key, k in self.marks().items() if k < last),
                (f'end, {self.time[-1]:g} s', last)]
        lines = [f'{self.source}: payload ± one standard deviation']
        for label, k in rows:
            mass, std = self.row(k)
            mark = ' *' if self.parts_as_told[k] else ''
            lines.append(f'  {label:>14}   {with_uncertainty(mass, std)} kg   '
                         f'{self.status[k]}{mark}')
        low, high = self.results()['interval95_kg']
        digits = decimals_of(std)
        changes = [f'  {f"change, {event.time:.2f} s":>14}   {event.before:.3g} -> '
                   f'{event.after:.3g} kg' for event in self.changes]
        reached = high > self.payload_max
        note = [f'  It reaches the largest payload that is looked for, {self.payload_max:.3g} kg: '
                '--payload-max raises that.'] if reached else []
        if_told = f', {IF_TOLD}' if self.parts_as_told[-1] else ''
        interval = f'{low:.{digits}f} … {high:.{digits}f} kg{if_told}'
        if any(self.parts_as_told[k] for _, k in rows):
            note.append(f'  * {IF_TOLD}')
        return '\n'.join([*lines, *changes, f'  {"95 % interval":>14}   {interval}', *note])


def estimate(log: Log, estimator: PayloadEstimator) -> Estimates:
    """
    Return the estimates of an estimator over a log.

    Across a lost sample the estimator predicts. The command of row k is applied from then on, so
    sample k is updated with that of row k - 1.

    Parameters
    ----------
    log : Log
        A log on an even grid.
    estimator : PayloadEstimator
        Built for the log's robot and sampling time; it is reset first.

    """
    estimator.reset()
    time = log.time - log.time[0]
    applied = np.vstack([np.zeros(2), log.command[:-1]])
    answers, as_told = [], []
    for t, y, u in zip(time, log.measured, applied):
        answers.append(estimator.update(float(t), y, u))
        # Now: the next sample, and `events`, may bring another mode.
        as_told.append(estimator.takes_parts_as_told)
    return Estimates(log.source, time, np.array([a.mass for a in answers]),
                     np.array([a.variance for a in answers]), tuple(a.status for a in answers),
                     tuple(as_told), estimator.payload_max, tuple(estimator.events))


def estimate_file(path: str, robot: Robot, name: str, model: str, modes: int,
                  payload_max: float | None = None) -> Estimates:
    """
    Return the estimates over a log file; the log's sampling time replaces the robot's.

    `payload_max` is the largest payload, kg; None takes what `largest_payload` says.

    Raises
    ------
    InputError
        File, robot or estimator do not fit; the message names what does not.

    """
    log = read_log_aloud(path, robot, model, modes, coriolis_of(name, robot, model))
    if name == 'rpe':
        say_if_compiling(compiled_step.step_packed)
    return estimate(log, make_estimator(
        name, replace(robot, sample_time=log.sample_time), model, modes, payload_max=payload_max))


def _payload_max(text: str) -> float:
    """Return the largest payload, kg, that the parameter of the node may be, too."""
    row, value = load_parameters()['payload_estimator']['payload_max'], command_line.number(text)
    try:
        row.check(value)
    except InputError:
        raise argparse.ArgumentTypeError(f'expected {row.expected}, got {text!r}') from None
    return value


def options_of(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed options."""
    options = command_line.parser('Estimate the payload over logs.')
    command_line.add_log_argument(options, '+')
    command_line.add_arm_arguments(options, payload=False)
    row = load_parameters()['payload_estimator']['estimator']
    options.add_argument('--estimator', default=row.default, choices=row.choices,
                         help='payload estimator')
    options.add_argument('--payload-max', default=0.0, type=_payload_max, metavar='KG',
                         help='largest payload that is looked for, kg; 0 is that of the node: '
                              'four lower links and twice the payload of the robot file')
    command_line.add_json_argument(options)
    return options.parse_args(arguments)


def _estimate(arguments: Sequence[str] | None) -> None:
    options = options_of(arguments)
    check_outputs({'--json': options.json}, [*options.log, options.robot])
    robot = load_robot(options.robot)
    with results() as write:
        _write(options, robot, write)


def _write(options: argparse.Namespace, robot: Robot, write: Callable[..., Any]) -> None:
    """Estimate over each log, print its table, and write JSON where asked."""
    words = described(options.estimator, robot, options.model, options.modes)
    write(print, f'{options.estimator}: {words}')
    found: list[Estimates] = []
    for path in options.log:
        one = write(estimate_file, path, robot, options.estimator, options.model, options.modes,
                    options.payload_max or None)
        if one is not None:
            found.append(one)
            write(print, one.table())
    forces = coriolis_of(options.estimator, robot, options.model)
    settings = {'robot': robot.name, 'estimator': options.estimator, 'model': options.model,
                'modes': options.modes, 'coriolis': 'estimated' if forces is None else forces}
    if options.json and found:
        logs = [item.results() for item in found]
        own = logs[0] if len(options.log) == 1 else {}
        write(command_line.write_json, options.json, {**settings, **own, 'logs': logs})


def main(arguments: Sequence[str] | None = None) -> int:
    """Run flex_estimate and return its exit code."""
    return command_line.run(lambda: _estimate(arguments))


if __name__ == '__main__':
    sys.exit(main())
