"""The logs below a folder, and the arm and robot file that each belongs to."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from msg_config.errors import InputError

ROBOT_FILE, LOGS, BAG = 'robot.yaml', ('.csv', '.mcap', '.db3'), 'metadata.yaml'


def logs_below(folders: Sequence[str], apart_from: Path) -> list[tuple[Path, Path]]:
    """
    Return (folder given, log) of every log below the folders, in the order of their names.

    A log that several folders or links lead to comes once, with the first of them.

    Parameters
    ----------
    folders : sequence of str
        As the user names them.
    apart_from : Path
        The fleet's own output, which is not searched.

    Raises
    ------
    InputError
        A folder that is none, or no log at all.

    """
    found: dict[Path, tuple[Path, Path]] = {}
    for name in folders:
        folder = Path(name)
        if not folder.is_dir():
            raise InputError(f'{name}: expected a folder of logs')
        for log in _logs(folder, apart_from.resolve()):
            found.setdefault(log.resolve(), (folder, log))
    if not found:
        raise InputError(f'{", ".join(folders)}: expected logs ({", ".join(LOGS)} or bag '
                         'folders), found none')
    return list(found.values())


def _logs(folder: Path, apart_from: Path) -> Iterator[Path]:
    real = folder.resolve()
    if real == apart_from:
        return
    if (folder / BAG).is_file():
        yield folder
        return
    for item in sorted(folder.iterdir()):
        # A link to where it came from leads round and round.
        if item.is_dir() and item.resolve() not in (real, *real.parents):
            yield from _logs(item, apart_from)
        elif not item.is_dir() and item.suffix.lower() in LOGS:
            yield item


def robot_of(folder: Path, log: Path, default: str) -> str:
    """Return the nearest robot.yaml between a log and the folder given, else the default."""
    for parent in log.parents:
        if (parent / ROBOT_FILE).is_file():
            return str(parent / ROBOT_FILE)
        if parent == folder:
            break
    return default


def arm_of(folder: Path, log: Path) -> str:
    """Return the arm's name: the folder that holds its logs, below and with the one given."""
    return (Path(folder.resolve().name) / log.parent.relative_to(folder)).as_posix()
