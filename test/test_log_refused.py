"""Files that are no logs are refused in one line."""

from __future__ import annotations

import os
from pathlib import Path
import socket

from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.logs.read import read_log
from flex_plant_sim.tools.log_input import read_logs
from msg_config.errors import InputError
import pytest

ROBOT = load_robot('reference')


def test_files_that_are_no_logs(tmp_path: Path) -> None:
    (tmp_path / 'empty.csv').write_text('')
    (tmp_path / 'log.txt').write_text('time')
    (tmp_path / 'binary.csv').write_bytes(b'\xff\x00\x01')
    (tmp_path / 'torn.mcap').write_bytes(b'\x89MCAP0\r\nand no more')
    (tmp_path / 'folder').mkdir()
    for name, message in [('empty.csv', 'expected a header row, the file is empty'),
                          ('log.txt', 'expected .csv, .mcap, .db3 or a bag folder'),
                          ('binary.csv', 'expected a readable text file'),
                          ('torn.mcap', 'expected a rosbag2'),
                          ('folder', 'expected a rosbag2, got a folder without metadata.yaml'),
                          ('absent.csv', 'expected a log, the file does not exist')]:
        with pytest.raises(InputError) as error:
            read_log(tmp_path / name, ROBOT)
        assert f'{name}: {message}' in str(error.value)
        assert '\n' not in str(error.value)


def test_what_waits_for_ever_when_opened_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'pipe.csv')
    (tmp_path / 'device.csv').symlink_to('/dev/zero')
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag' / 'metadata.yaml').touch()
    os.mkfifo(tmp_path / 'bag' / 'bag_0.mcap')
    with socket.socket(socket.AF_UNIX) as own, pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path)  # names of sockets are short
        own.bind('socket.mcap')
        for name, message in [
                ('pipe.csv', 'pipe.csv: expected a file or a bag folder, got a FIFO'),
                ('device.csv', 'device.csv: expected a file or a bag folder, got a device'),
                ('socket.mcap', 'socket.mcap: expected a file or a bag folder, got a socket'),
                ('bag', 'bag/bag_0.mcap: expected a file, got a FIFO')]:
            with pytest.raises(InputError) as error:
                read_log(name, ROBOT)
            assert str(error.value) == message
    with pytest.raises(InputError, match="or a YAML file, got .*pipe.csv', a FIFO"):
        load_robot(tmp_path / 'pipe.csv')


HEADER = 'time,command_1,command_2,joint_1,joint_2,strain_1a,strain_1b,strain_2a,strain_2b'
ROWS = [f'{0.01 * k:.2f},1,2,3,4,.005,.004,.003,.002' for k in range(4)]


@pytest.mark.parametrize('lines, message', [
    (['# recorder 3', f'"{HEADER}', *ROWS],
     "line 2: expected quotes in pairs, got one left open at 'time,command_1,"),
    ([HEADER.replace('joint_1', '"joint_1'), *ROWS],
     "line 1: expected quotes in pairs, got one left open at 'joint_1,joint_2,"),
    ([HEADER, *ROWS[:2], ROWS[2].replace(',3', ',"3'), ROWS[3]],
     'line 4: expected 9 columns, got 4 (a quote is left open)')])
def test_a_quote_without_a_partner_is_named(
        tmp_path: Path, lines: list[str], message: str) -> None:
    (tmp_path / 'log.csv').write_text('\n'.join([*lines, '']))
    with pytest.raises(InputError) as error:
        read_log(tmp_path / 'log.csv', ROBOT)
    assert message in str(error.value)


def test_a_quote_within_a_name_that_is_not_read_does_no_harm(tmp_path: Path) -> None:
    lines = [f'{HEADER},5" pipe', *(f'{row},1' for row in ROWS), '']
    (tmp_path / 'log.csv').write_text('\n'.join(lines))
    assert len(read_log(tmp_path / 'log.csv', ROBOT)) == 4


def test_a_log_with_a_gap_says_how_it_is_diagnosed(tmp_path: Path) -> None:
    rows = [f'{0.01 * k + (3.0 if k >= 60 else 0.0):.2f},1,2,{0.001 * k},4,.005,.004,.003,.002'
            for k in range(100)]
    (tmp_path / 'log.csv').write_text('\n'.join([HEADER, *rows, '']))
    with pytest.raises(InputError) as error:
        read_logs([str(tmp_path / 'log.csv')], ROBOT, 'assumed_modes', 3)
    assert str(error.value).endswith(
        'not diagnosed: a gap in time: only the longest stretch without one is read, line 2 to '
        'line 61, 60 of 100 samples; to diagnose it, keep its rows alone in a file')


@pytest.mark.parametrize(('count', 'said'), [(5, False), (100, True)])
def test_some_rows_do_not_tell_that_a_channel_is_stuck(
        count: int, said: bool, tmp_path: Path) -> None:
    """An arm that rests in its first rows has equal angles, and strains with noise."""
    rows = [f'{0.01 * k:.2f},0,0,0,0.002,{1e-6 * (k % 3)},{1e-6 * (k % 2)},1e-06,{2e-07 * (k % 5)}'
            for k in range(count)]
    (tmp_path / 'log.csv').write_text('\n'.join([HEADER, *rows, '']))
    assert any('stuck' in note for note in read_log(tmp_path / 'log.csv', ROBOT).notes) == said
