"""Logs as CSV: one header row, then one row a sample."""

from __future__ import annotations

import csv
from pathlib import Path

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.atomic_file import whole_file
from flex_plant_sim.logs.log import checked, Log
from msg_config.errors import InputError
import numpy as np

MOTION = ('time', 'command_1', 'command_2', 'joint_1', 'joint_2')
VELOCITY = ('velocity_1', 'velocity_2')


def read_csv(path: Path, robot: Robot) -> Log:
    """
    Return the record in a CSV file.

    Columns, in any order: time (s), command_1, command_2 (the drives' own unit), joint_1,
    joint_2 (rad), the robot's gauges (m/m), and velocity_1, velocity_2 (rad/s) if there are
    any. Other columns are left alone.

    Raises
    ------
    InputError
        Missing column, wrong gauges, no number, not finite, uneven time; with its line.

    """
    header, values = _table(path)
    _check_columns(path, header, robot)

    def pick(names: tuple[str, ...]) -> Array:
        return values[:, [header.index(name) for name in names]]

    velocity = pick(VELOCITY) if set(VELOCITY) <= set(header) else None
    motion = pick(MOTION)
    log = Log(str(path), motion[:, 0], motion[:, 1:3], motion[:, 3:], pick(robot.gauge_names),
              robot.gauge_names, velocity)
    return checked(log, lambda k: f'line {k + 2}')


def write_csv(path: str | Path, log: Log) -> None:
    """
    Write a log with 9 digits, whole or not at all.

    Raises
    ------
    InputError
        If nothing can be written there.

    """
    columns = [log.time[:, None], log.command, log.joint, log.strain]
    names = [*MOTION, *log.gauge_names]
    if log.velocity is not None:
        columns.append(log.velocity)
        names += VELOCITY
    with whole_file(path) as temporary:
        np.savetxt(temporary, np.hstack(columns), fmt='%.9g', delimiter=',',
                   header=','.join(names), comments='')


def _table(path: Path) -> tuple[list[str], Array]:
    try:
        with open(path, encoding='utf-8-sig', newline='') as file:
            header = [name.strip() for name in next(csv.reader(file), [])]
            if not header:
                raise InputError(f'{path}: expected a header row, the file is empty')
            values = _numbers(path, header, file.readlines())
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f'{path}: expected a readable text file, got: {error}') from None
    return header, values


def _numbers(path: Path, header: list[str], lines: list[str]) -> Array:
    if not any(line.strip() for line in lines):
        raise InputError(f'{path}: expected at least 2 samples, got 0')
    try:
        values = np.loadtxt(lines, delimiter=',', ndmin=2, comments=None)
        if values.shape[1] == len(header):
            return values
    except ValueError:
        pass
    raise InputError(f'{path}: {_fault(header, lines)}')


def _fault(header: list[str], lines: list[str]) -> str:
    """Return what is wrong in the first row that is not one number a column."""
    for number, row in enumerate(csv.reader(lines), start=2):
        if len(row) != len(header):
            return f'line {number}: expected {len(header)} columns, got {len(row)}'
        for name, text in zip(header, row):
            try:
                float(text)
            except ValueError:
                return f'line {number}: {name}: expected a number, got {text!r}'
    return f'expected {len(header)} numbers a line'


def _check_columns(path: Path, header: list[str], robot: Robot) -> None:
    twice = [name for name in header if header.count(name) > 1]
    if twice:
        raise InputError(f'{path}: column {twice[0]}: expected once, got {header.count(twice[0])}')
    gauges = [name for name in header if name.startswith('strain_')]
    if len(gauges) != len(robot.gauge_names):
        raise InputError(f'{path}: strain: expected {len(robot.gauge_names)} gauges '
                         f'({", ".join(robot.gauge_names)}) for {robot.name}, got '
                         f'{len(gauges)} ({", ".join(gauges) or "none"})')
    for name in (*MOTION, *robot.gauge_names):
        if name not in header:
            raise InputError(f'{path}: column {name}: missing, got {", ".join(header)}')
