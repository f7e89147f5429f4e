"""Logs whose clock or numbers are of no scale that an arm has are told in one line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
import warnings

from flex_plant_sim.arm.robot_file import load_robot, parse_robot, robot_text
from flex_plant_sim.logs.bag_log import write_bag
from flex_plant_sim.logs.log import Log
from flex_plant_sim.logs.read import read_log
from msg_config.errors import InputError
import numpy as np
import pytest

ROBOT = load_robot('reference')
HEADER = 'time,command_1,command_2,joint_1,joint_2,strain_1a,strain_1b,strain_2a,strain_2b'


def write_rows(path: Path, every: float) -> Path:
    rows = [f'{every * k:g},1,2,3,4,.005,.004,.003,.002' for k in range(120)]
    path.write_text('\n'.join([HEADER, *rows]) + '\n')
    return path


@pytest.mark.parametrize('every, unit, factor, told', [
    # ms, also at 1 kHz, as s and us; ten times too few ms; row numbers.
    (10.0, 's', 1.0, '`s`'), (1.0, 's', 1.0, '`s`'), (10.0, 'us', 1e-6, '`us`'),
    (1.0, 'ms, scale: 1000', 1.0, '`s`'), (1.0, 's, scale: 5', 5.0, '`scale`')])
def test_a_unit_that_is_named_wrongly_is_refused(
        every: float, unit: str, factor: float, told: str, tmp_path: Path) -> None:
    robot = parse_robot(f'{robot_text("reference")}\ninputs: {{time: {{unit: {unit}}}}}\n',
                        'a.yaml')
    path = write_rows(tmp_path / 'log.csv', every)
    with pytest.raises(InputError) as error:
        read_log(path, robot)
    assert str(error.value) == (
        f'{path}: time: expected a sample every 0.000333 to 0.3 s, as sample_time_s of a.yaml is '
        f'0.01 s, got one every {every * factor:.6g} s: is {told} under inputs: time: in the '
        'robot file right?')


@pytest.mark.parametrize('named', ['unit: s', 'name: time'])
@pytest.mark.parametrize('every, sample_time, ends', [
    (20.0, 1.0, '0.0333 to 1'), (1e-6, 1e-5, '1e-05 to 0.0003')])
def test_no_sample_time_is_beyond_that_of_any_robot_file(
        every: float, sample_time: float, ends: str, named: str, tmp_path: Path) -> None:
    robot = replace(ROBOT, sample_time=sample_time, inputs=parse_robot(
        f'{robot_text("reference")}\ninputs: {{time: {{{named}}}}}\n', 'a.yaml').inputs)
    with pytest.raises(InputError, match=f'expected a sample every {ends} s, as'):
        read_log(write_rows(tmp_path / 'log.csv', every), robot)


def test_stamps_of_a_bag_are_a_clock_whatever_the_robot_file_says(tmp_path: Path) -> None:
    log = Log('log', 1e-4 * np.arange(200.0), np.zeros((200, 2)), np.zeros((200, 2)),
              np.zeros((200, 4)), ROBOT.gauge_names)
    write_bag(tmp_path / 'bag', log)
    assert read_log(tmp_path / 'bag', ROBOT).sample_time == pytest.approx(1e-4)


@pytest.mark.parametrize('first', ['1e308', '-1e308'])
@pytest.mark.parametrize('inputs', ['', 'inputs: {joints: {joint_1: {scale: 1000}}}'])
def test_a_number_near_the_largest_is_refused_like_others(
        first: str, inputs: str, tmp_path: Path) -> None:
    robot = parse_robot(f'{robot_text("reference")}\n{inputs}\n', 'a.yaml')
    path = write_rows(tmp_path / 'log.csv', 0.01)
    lines = path.read_text().splitlines()
    number = 0.003 if inputs else 3
    lines[1:] = [line.replace(',3,', f',{number},', 1) for line in lines[1:]]
    lines[60] = lines[60].replace(f',{number},', f',{first},', 1)
    path.write_text('\n'.join([*lines, '']))
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        log = read_log(path, robot)
    assert log.joint[:, 0] == pytest.approx(3.0)
    assert log.notes[0].startswith('1 of 120 samples refused (1 ')
