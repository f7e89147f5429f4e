"""
The journal of a fleet: one line per finished log, by which an interrupted run goes on.

Lines of another kind name the tables that were written, each with a digest of its contents.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict
import fcntl
import json
import os
from pathlib import Path
from typing import Any, IO

from flex_payload_estimator.fleet.log_task import LogTask, Row
from flex_plant_sim.atomic_file import digest_of
from flex_plant_sim.tools.command_line import package_version
from msg_config.errors import InputError

FILE = 'fleet.jsonl'


class Journal:
    """
    The rows of the finished logs, in a file of the output folder; a killed run leaves it usable.

    Until it is closed, or its process ends, no other fleet gets the folder: two would remove each
    other's files.

    Parameters
    ----------
    folder : Path
        Output folder; made where it does not exist.

    Raises
    ------
    InputError
        The folder is a file, holds other files than a fleet's, is in use by another fleet, or
        cannot be written.

    """

    def __init__(self, folder: Path):
        self.folder, self.file = folder, folder / FILE
        if folder.exists() and not folder.is_dir():
            raise InputError(f'{folder}: expected a folder, got a file')
        if folder.is_dir() and not self.file.is_file() and any(folder.iterdir()):
            raise InputError(f"{folder}: expected an empty folder or an earlier flex_fleet's, "
                             'got one with other files')
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._held = self.file.open('a')
        except OSError as error:
            raise InputError(f'{folder}: expected a writable folder, got: {error}') from None
        if not _locked(self._held):
            self.close()
            raise InputError(f'{folder}: expected a folder of its own, got one that another '
                             'flex_fleet is writing to')

    def close(self) -> None:
        """Leave the folder to others."""
        self._held.close()

    def rows(self) -> dict[str, Row]:
        """Return this version's rows by their task's key, without what is to be done again."""
        found = {}
        for entry in self._lines():
            try:
                number, key, row = entry
                found[number, key] = Row(**{**row, 'causes': tuple(row['causes'])})
            except (ValueError, TypeError, KeyError):
                continue
        return {key: row for (number, key), row in found.items()
                if number == package_version() and not row.again}

    def add(self, task: LogTask, row: Row) -> None:
        """
        Append the row of a task; it is on the disk when this returns.

        Raises
        ------
        InputError
            The row cannot be written.

        """
        self._append([package_version(), task.key, asdict(row)])

    def note(self, table: Path) -> None:
        """Append the name and digest of a table of this folder, wherever it is now."""
        entry = [table.name, digest_of(table)]
        if entry not in self._lines():
            self._append(entry)

    def wrote(self, name: str) -> bool:
        """Return whether a table of this folder is as a fleet wrote it."""
        table = self.folder / name
        return table.is_file() and [name, digest_of(table)] in self._lines()

    def _lines(self) -> Iterator[Any]:
        for line in self.file.read_text(encoding='utf-8', errors='replace').splitlines():
            with suppress(ValueError):
                yield json.loads(line)

    def _append(self, entry: list[Any]) -> None:
        try:
            with self.file.open('a', encoding='utf-8') as file:
                # A line that a kill cut short must not swallow this one.
                file.write('\n' if file.tell() and not self._ends_with_newline() else '')
                file.write(json.dumps(entry) + '\n')
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise InputError(f'{self.file}: expected room for a row, got: '
                             f'{error.strerror or error}') from None

    def _ends_with_newline(self) -> bool:
        with self.file.open('rb') as file:
            file.seek(-1, os.SEEK_END)
            return file.read(1) == b'\n'


def _locked(file: IO[str]) -> bool:
    """Lock a file for this process, and return whether no other process has locked it."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass  # On a file system without locks a second fleet goes unnoticed.
    return True
