"""Reads a log in any storage format; the entry of the tools to this package."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Protocol

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.file_kind import FILE, file_kind, FOLDER, NOTHING
from flex_plant_sim.logs.bag_log import read_bag
from flex_plant_sim.logs.csv_log import read_csv
from flex_plant_sim.logs.log import Log
from msg_config.errors import InputError, printable

# What a bag folder holds beside its storage.
METADATA = 'metadata.yaml'


class LogReader(Protocol):
    """A storage format of logs."""

    def __call__(self, path: Path, robot: Robot) -> Log:
        """
        Return the record in a file or folder, checked.

        Raises
        ------
        InputError
            Names file and row, column or topic, what was expected and what was found.

        """


def read_log(path: str | Path, robot: Robot) -> Log:
    """
    Return the record in a CSV file or in a rosbag2 (sqlite3, MCAP; folder or single file).

    Raises
    ------
    InputError
        Names file and row, column or topic, what was expected and what was found.

    """
    path = Path(path)
    if not path.exists():
        raise InputError(f'{path}: expected a log, the file does not exist')
    log = _reader(path)(path, robot)
    return replace(log, source=printable(log.source))


def stored_at(path: str | Path) -> frozenset[tuple[int, int]]:
    """
    Return device and number of the files that hold a log, whatever names lead to them.

    Of a bag folder these are all but metadata.yaml; what cannot be looked at has none.
    """
    found = set()
    try:
        inside = [item for item in Path(path).iterdir() if item.name != METADATA] \
            if Path(path).is_dir() else [Path(path)]
        for item in inside:
            said = item.stat()
            found.add((said.st_dev, said.st_ino))
    except (OSError, ValueError):
        return frozenset()
    return frozenset(found)


def _reader(path: Path) -> LogReader:
    kind = file_kind(path)
    if kind not in (FILE, FOLDER):
        raise InputError(f'{path}: expected a file or a bag folder, got {kind}')
    if kind == FOLDER:
        if not (path / METADATA).is_file():
            raise InputError(f'{path}: expected a rosbag2, got a folder without metadata.yaml '
                             '(`ros2 bag reindex` makes one)')
        for item in sorted(path.iterdir()):
            if file_kind(item) not in (FILE, FOLDER, NOTHING):
                raise InputError(f'{item}: expected a file, got {file_kind(item)}')
        return read_bag
    suffix = path.suffix.lower()
    if suffix in ('.mcap', '.db3'):
        return read_bag
    if suffix == '.csv':
        return read_csv
    raise InputError(f'{path}: expected .csv, .mcap, .db3 or a bag folder, got {path.suffix!r}')
