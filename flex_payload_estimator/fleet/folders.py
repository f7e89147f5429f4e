"""
The logs below a folder, and the arm and robot file that each belongs to.

First step of flex_fleet: folders -> log tasks -> rows in the journal -> table.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from flex_payload_estimator.fleet.journal import FILE as JOURNAL
from flex_plant_sim.arm.robot_file import built_in_robots
from msg_config.errors import InputError

# Robot file of a folder, suffixes of log files, and the file that marks a bag folder.
ROBOT_FILE, LOGS, BAG = 'robot.yaml', ('.csv', '.mcap', '.db3'), 'metadata.yaml'


def logs_below(folders: Sequence[str], apart_from: Path) -> list[tuple[Path, Path]]:
    """
    Return (folder given, log) of every log below the folders, in the order of their names.

    A log that several folders or links lead to is returned once, with the first of them.

    Parameters
    ----------
    folders : sequence of str
        The folders as the user names them.
    apart_from : Path
        The fleet's own output folder, which is not searched.

    Raises
    ------
    InputError
        A name is no folder, or that of outputs, or there is no log at all.

    """
    found: dict[Path, tuple[Path, Path]] = {}
    for name in folders:
        folder = Path(name)
        if not folder.is_dir():
            raise InputError(f'{name}: expected a folder of logs')
        if (folder / BAG).is_file():
            raise InputError(f'{name}: expected a folder of logs, got one bag; name the folder '
                             'that it is in')
        if _is_output(folder, apart_from.resolve()):
            raise InputError(f'{name}: expected logs, got the folder that a fleet writes to, '
                             'where none are looked for: name another by --out')
        for log in _logs(folder, apart_from.resolve()):
            found.setdefault(log.resolve(), (folder, log))
    if not found:
        raise InputError(f'{", ".join(folders)}: expected logs ({", ".join(LOGS)} or bag '
                         'folders), found none')
    return list(found.values())


def _logs(folder: Path, apart_from: Path) -> Iterator[Path]:
    """Yield the log files and bag folders below a folder."""
    real = folder.resolve()
    if _is_output(folder, apart_from):
        return
    if (folder / BAG).is_file():
        yield folder
        return
    for item in sorted(folder.iterdir()):
        # A link to a folder above it would be followed for ever.
        if item.is_dir() and item.resolve() not in (real, *real.parents):
            yield from _logs(item, apart_from)
        elif not item.is_dir() and item.suffix.lower() in LOGS:
            yield item


def _is_output(folder: Path, own: Path) -> bool:
    """Return whether a folder is this fleet's own output, or that of another."""
    return folder.resolve() == own or (folder / JOURNAL).is_file()


def robot_of(folder: Path, log: Path, default: str) -> str:
    """Return the robot.yaml nearest to a log, up to the folder given, else the default."""
    for parent in log.parents:
        if (parent / ROBOT_FILE).is_file():
            return str((parent / ROBOT_FILE).absolute())
        if parent == folder:
            break
    return default if default in built_in_robots() else str(Path(default).absolute())


def arm_of(folder: Path, log: Path) -> str:
    """Return the arm's name: the path of the log's folder, beginning with the folder given."""
    return (Path(folder.resolve().name) / log.parent.relative_to(folder)).as_posix()
