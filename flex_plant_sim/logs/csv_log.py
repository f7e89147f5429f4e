"""
Reads and writes logs as CSV: one header row, then one row for each sample.

`csv_table` reads the table and `rows` turns its rows into a log.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
import re

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.atomic_file import whole_file
from flex_plant_sim.inputs.plausible import check_sampling, time_unit
from flex_plant_sim.inputs.resample import usual_interval
from flex_plant_sim.logs.csv_table import read_table, Table
from flex_plant_sim.logs.log import Log
from flex_plant_sim.logs.origin import csv_origin, write_origin
from flex_plant_sim.logs.rows import Rows, to_log
from msg_config.errors import InputError
from msg_config.input_mapping import CONTRACT, InputMapping, TIME_UNITS
import numpy as np

# What a column of strain is named.
GAUGE_NAME = re.compile(r'strain_\d+[a-z]?')


def read_csv(path: Path, robot: Robot) -> Log:
    """
    Return the record in a CSV file.

    Columns, in any order: time (s), command_1, command_2 (the drives' own unit), joint_1,
    joint_2 (rad) and the robot's gauges (m/m); or as the section `inputs:` of the robot file names
    them. Other columns are ignored, but for strain of gauges that the robot file does not have.

    Raises
    ------
    InputError
        A missing column, wrong gauges, text in place of a number, values that no arm has, or
        uneven time; names the line.

    """
    table = read_table(path)
    mapping, columns = robot.inputs, list(robot.inputs.columns(robot.gauge_names).values())
    _check_columns(table, robot, columns)
    values = table.numbers(columns)
    joints, commands = mapping.joint_channels(), mapping.command_channels()
    gauges = mapping.gauge_channels(robot.gauge_names)
    rows = Rows(str(path), values[:, 0], joints.si(values[:, 3:5]), gauges.si(values[:, 5:]),
                commands.si(values[:, 1:3]), lambda k: f'line {table.numbers_of_lines[k]}',
                table.notes)
    log = to_log(_in_seconds(rows, robot), robot)
    return replace(log, origin=csv_origin(path))


def _in_seconds(rows: Rows, robot: Robot) -> Rows:
    """Return the rows with time in s; a unit that is not given is found from the interval."""
    name, given = robot.inputs.time.name, robot.inputs.time.factor
    told = len(rows.time) > 1 and np.isfinite(rows.time).all()
    interval = usual_interval(rows.time) if told else 0.0
    if not interval > 0.0:
        # What is no order of times is said, by row, where the grid is made.
        return replace(rows, time=rows.time * (given or 1.0))
    if given:
        named = next((key for key, factor in TIME_UNITS.items() if factor == given), 'scale')
        check_sampling(f'{rows.source}: {name}', interval * given, robot,
                       f'`{named}` under inputs: time: in the robot file')
        return replace(rows, time=rows.time * given)
    unit = time_unit(interval, robot.sample_time)
    if unit is None:
        raise InputError(f'{rows.source}: {name}: expected a sample about every '
                         f'{robot.sample_time:g} s as {robot.source} says, got one every '
                         f'{interval:.6g}: name its unit in the robot file, inputs: {{time: '
                         '{unit: ms}}, or of row numbers the interval, s: {time: {scale: '
                         f'{robot.sample_time:g}}}}}')
    if unit == 's':
        check_sampling(f'{rows.source}: {name}', interval, robot, 'its unit, s,')
        return rows
    return replace(rows, time=rows.time * TIME_UNITS[unit]).noted(
        f'{name}: a sample every {interval:.6g}, taken as {unit}')


def write_csv(path: str | Path, log: Log, inputs: InputMapping = CONTRACT) -> None:
    """
    Write a log with 9 digits, whole or not at all, and its origin in a file beside it.

    Parameters
    ----------
    path : str or Path
        The file.
    log : Log
        In SI units.
    inputs : InputMapping
        Names and units of the arm's robot file, so that the log can be read with that file.

    Raises
    ------
    InputError
        Nothing can be written there.

    """
    joints, gauges = inputs.joint_channels(), inputs.gauge_channels(log.gauge_names)
    columns = [log.time[:, None] / (inputs.time.factor or 1.0),
               inputs.command_channels().outside(log.command), joints.outside(log.joint),
               gauges.outside(log.strain)]
    with whole_file(path) as temporary:
        np.savetxt(temporary, np.hstack(columns), fmt='%.9g', delimiter=',',
                   header=','.join(inputs.columns(log.gauge_names).values()), comments='')
    if log.origin is not None:
        write_origin(Path(path), log.origin)


def _check_columns(table: Table, robot: Robot, wanted: list[str]) -> None:
    path, header = table.path, table.header
    twice = [name for name in wanted if header.count(name) > 1]
    if twice:
        raise InputError(f'{path}: column {twice[0]}: expected once, got {header.count(twice[0])}')
    _check_present(table, wanted[:-len(robot.gauge_names) or None])
    gauges = [name for name in header if GAUGE_NAME.fullmatch(name)]
    if not robot.inputs.gauges and len(gauges) != len(robot.gauge_names):
        # With some left out, strain_1 of one file may be strain_1b of the other.
        count = len(robot.gauge_names)
        more = "; to leave the others alone, name the arm's under inputs: in the robot file" \
            if len(gauges) > count > 0 else ''
        raise InputError(f'{path}: strain: expected {count} gauge{"" if count == 1 else "s"} '
                         f'({", ".join(robot.gauge_names) or "none"}) for {robot.source}, got '
                         f'{len(gauges)} ({", ".join(gauges) or "none"}){more}')
    _check_present(table, wanted)


def _check_present(table: Table, wanted: list[str]) -> None:
    for name in wanted:
        if name not in table.header:
            raise InputError(f'{table.path}: column {name}: missing, got '
                             f'{", ".join(table.header)}; other names are to be told under '
                             'inputs: in the robot file')
