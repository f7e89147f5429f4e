"""Files of bags."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from attack.run import good_log, ROBOT
from flex_plant_sim.logs.bag_log import write_bag
from flex_plant_sim.logs.read import read_log
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
