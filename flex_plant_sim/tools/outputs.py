"""The outputs of a tool: checked before the work, written so that one failure keeps the rest."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
import os
from pathlib import Path
import sys
from tempfile import TemporaryFile
from typing import Any

from flex_plant_sim.atomic_file import check_replaceable
from msg_config.errors import InputError

# Bytes, as file systems have them: an empty file has room on a full disk.
BLOCK = 4096
IMAGES = ('.png', '.pdf', '.svg')


def check_outputs(outputs: Mapping[str, str | Path | None], inputs: Sequence[str | Path],
                  folder: bool = False) -> None:
    """
    Raise, before any work, where an output cannot be written or would replace something.

    An output replaces nothing but an empty file, or an earlier output of these tools.

    Parameters
    ----------
    outputs : Mapping
        Option to its file or folder; None where it is not asked for.
    inputs : sequence of path
        What the tool reads; names that are no paths do no harm.
    folder : bool
        Whether the outputs are folders written whole.

    Raises
    ------
    InputError
        Naming the option and the place.

    """
    places = {option: Path(path) for option, path in outputs.items() if path is not None}
    for option, place in places.items():
        for read in map(Path, inputs):
            if _overlap(place, read):
                raise InputError(f'{option}: {place}: expected another place than the input '
                                 f'{read}')
        for other, second in places.items():
            if other != option and _same(place, second):
                raise InputError(f'{option}: {place}: expected another place than {other}')
        check_replaceable(place, folder)
        _check_room(place)


def check_folder(option: str, folder: str | Path, names: Sequence[str],
                 inputs: Sequence[str | Path] = (), nested: bool = False) -> None:
    """
    Raise where a folder, made if need be, cannot take files of these names.

    Other files in it are left alone; nested, the folders around it are made as well.

    Raises
    ------
    InputError
        Naming the option and the place.

    """
    folder = Path(folder)
    standing = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not standing.is_dir():
        raise InputError(f'{option}: {folder}: expected a folder, got a file {standing}')
    if folder.is_dir():
        _check_room(folder / 'any')
        check_outputs({option if k == 0 else f'{option} ({name})': folder / name
                       for k, name in enumerate(names)}, inputs)
    elif nested:
        _check_room(standing / folder.name)
    else:
        check_outputs({option: folder}, inputs)


def _same(a: Path, b: Path) -> bool:
    if os.path.realpath(a) == os.path.realpath(b):
        return True
    try:
        return os.path.samefile(a, b)
    except OSError:
        return False


def _overlap(output: Path, read: Path) -> bool:
    """Return whether one is the other, or lies in it; a file of the same folder does not."""
    if not read.exists():
        return False
    a, b = Path(os.path.realpath(output)), Path(os.path.realpath(read))
    return _same(output, read) or b in a.parents or a in b.parents


def _check_room(place: Path) -> None:
    """Write a block where the output shall stand, and let it vanish."""
    try:
        with TemporaryFile(dir=Path(os.path.realpath(place)).parent) as file:
            file.write(b'0' * BLOCK)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise InputError(f'{place}: expected a writable place, got: '
                         f'{error.strerror or error}') from None


def check_image(path: str | Path) -> None:
    """
    Raise where a name has not the suffix of an image.

    Raises
    ------
    InputError

    """
    if Path(path).suffix not in IMAGES:
        raise InputError(f'{path}: expected an image suffix, {", ".join(IMAGES)}, '
                         f'got {Path(path).suffix!r}')


@contextmanager
def results() -> Iterator[Callable[..., None]]:
    """
    Yield a function that calls what writes one output, and goes on after a failure.

    Raises
    ------
    InputError
        At the end: the first failure, and how many more there were.

    """
    failed: list[str] = []

    def write(writer: Callable[..., Any], *arguments: Any) -> None:
        try:
            writer(*arguments)
            if writer is print:
                sys.stdout.flush()
        except InputError as error:
            failed.append(str(error))
        except OSError as error:
            where = 'standard output' if writer is print else arguments[0]
            failed.append(f'{where}: expected a writable place, got: {error.strerror or error}')
            if writer is print:
                forget_standard_output()

    yield write
    if failed:
        more = f'; {len(failed) - 1} more outputs failed' if len(failed) > 1 else ''
        raise InputError(f'{failed[0]}{more}')


def forget_standard_output() -> None:
    """Let what nobody can read vanish, so that no later flush fails again."""
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
    except (OSError, ValueError):  # standard output may be closed, or no file
        sys.stdout = open(os.devnull, 'w')
