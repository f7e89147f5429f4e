"""Files of bags: suffixes in capitals, packed messages, joints apart, and logs named twice."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from attack.run import good_log, ROBOT
from flex_plant_sim.logs.bag_log import write_bag
from flex_plant_sim.logs.read import read_log
from flex_plant_sim.tools.log_input import read_logs
from msg_config.errors import InputError
import numpy as np
import pytest


@pytest.mark.parametrize('storage, suffix', [('mcap', 'mcap'), ('sqlite3', 'db3')])
def test_a_suffix_in_capitals_is_the_same(
        storage: Literal['mcap', 'sqlite3'], suffix: str, tmp_path: Path) -> None:
    log = good_log(20)
    write_bag(tmp_path / 'bag', log, storage)
    for name in (f'LOG.{suffix.upper()}', f'log.{suffix.capitalize()}'):
        (tmp_path / name).hardlink_to(tmp_path / 'bag' / f'bag.{suffix}')
        np.testing.assert_allclose(read_log(tmp_path / name, ROBOT).joint, log.joint)


@pytest.mark.parametrize('second', ['bag/bag.mcap', 'link.mcap', 'log', '../bag'])
def test_a_log_that_two_names_lead_to_is_read_once(second: str, tmp_path: Path) -> None:
    """Its evidence would count twice."""
    folder = tmp_path / 'here'
    folder.mkdir()
    write_bag(folder / 'bag', good_log(20))
    (tmp_path / 'bag').symlink_to(folder / 'bag')
    (folder / 'log').symlink_to(folder / 'bag')
    (folder / 'link.mcap').hardlink_to(folder / 'bag' / 'bag.mcap')
    names = [str(folder / 'bag'), str(folder / second)]
    with pytest.raises(InputError) as error:
        read_logs(names, ROBOT, 'assumed_modes', 2)
    assert str(error.value) == f'{names[1]}: expected each log once, got what {names[0]} holds'


def test_equal_logs_in_two_files_are_two(tmp_path: Path) -> None:
    for name in ('a', 'b'):
        write_bag(tmp_path / name, good_log(20))
    logs = read_logs([str(tmp_path / name) for name in ('a', 'b')], ROBOT, 'assumed_modes', 2)
    assert len(logs) == 2
