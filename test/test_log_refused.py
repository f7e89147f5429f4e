"""Files that are no logs are refused in one line, before anything waits for them."""

from __future__ import annotations

import os
from pathlib import Path

from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.logs.read import _reader, read_log
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


@pytest.mark.parametrize('name', ['log.csv', 'log.mcap', 'log.db3'])
def test_a_pipe_is_no_log(tmp_path: Path, name: str) -> None:
    """Nobody writes to it: a reader would wait forever, so the choice of one refuses it."""
    os.mkfifo(tmp_path / name)
    with pytest.raises(InputError, match=f'{name}: expected a file or a bag folder, got a pipe'):
        _reader(tmp_path / name)
