"""
Checks the outputs of a tool before its work, and writes them after it.

If one output cannot be written, the others still are; where a tool takes its logs one by one, a
bad one costs none of the others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import combinations
import os
from pathlib import Path
import sys
from tempfile import TemporaryFile
from typing import Any

from flex_plant_sim.atomic_file import check_name, check_replaceable
from msg_config.errors import InputError

# Block size of file systems, bytes: an empty file could be created even on a full disk.
BLOCK = 4096
IMAGES = ('.png', '.pdf', '.svg')


def check_outputs(outputs: Mapping[str, str | Path | None], inputs: Sequence[str | Path],
                  folder: bool = False) -> None:
    """
    Check, before any work, that the outputs can be written and replace nothing else.

    An output may replace only an empty file or an earlier output of these tools.

    Parameters
    ----------
    outputs : Mapping
        Option to its file or folder; None if the option is not given.
    inputs : sequence of path
        Files that the tool reads; names that are no paths are ignored.
    folder : bool
        Whether the outputs are folders that are written whole.

    Raises
    ------
    InputError
        Names the option and the path.

    """
    places = {option: Path(path) for option, path in outputs.items() if path is not None}
    check_apart(places)
    for option, place in places.items():
        for read in map(Path, inputs):
            if _overlap(place, read):
                raise InputError(f'{option}: {place}: expected another place than the input '
                                 f'{read}')
        check_replaceable(place, folder)
        _check_room(place)


def check_apart(places: Mapping[str, Path]) -> None:
    """Raise InputError where two options name one place, folder or file."""
    for (option, place), (other, second) in combinations(places.items(), 2):
        if _same(place, second):
            raise InputError(f'{option}: {place}: expected another place than {other}')


def check_folder(option: str, folder: str | Path, names: Sequence[str],
                 inputs: Sequence[str | Path] = (), nested: bool = False) -> None:
    """
    Check that files of these names can be written to a folder, which may have to be created.

    Other files in it are ignored. With `nested`, its parent folders may be missing as well.

    Raises
    ------
    InputError
        Names the option and the path.

    """
    check_name(folder)
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
    """Return whether two paths are the same, or one is a folder that contains the other."""
    if not read.exists():
        return False
    a, b = Path(os.path.realpath(output)), Path(os.path.realpath(read))
    return _same(output, read) or b in a.parents or a in b.parents


def _check_room(place: Path) -> None:
    """Check that there is room for an output: write a temporary block beside it."""
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
    Check that a file name has the suffix of an image.

    Raises
    ------
    InputError
        It has another suffix.

    """
    if Path(path).suffix not in IMAGES:
        raise InputError(f'{path}: expected an image suffix, {", ".join(IMAGES)}, '
                         f'got {Path(path).suffix!r}')


@contextmanager
def results() -> Iterator[Callable[..., Any]]:
    """
    Yield a function that calls the writer of one output, or what reads one log.

    It returns what the call returns, or None after a failure, after which it continues.

    Raises
    ------
    InputError
        At the end of the block; tells each failure once.
    Exception
        At the end of the block: the first that was unforeseen, which costs no other output either.

    """
    failed: dict[str, Exception] = {}
    unforeseen: list[Exception] = []

    def write(writer: Callable[..., Any], *arguments: Any) -> Any:
        try:
            found = writer(*arguments)
            if writer is print:
                sys.stdout.flush()
            return found
        except InputError as error:
            failed[str(error)] = error
        except OSError as error:
            where = 'standard output' if writer is print else arguments[0]
            reason = error.strerror or error
            failed[f'{where}: expected a writable place, got: {reason}'] = error
            if writer is print:
                forget_standard_output()
        except Exception as error:  # noqa: B902  the others are written first
            unforeseen.append(error)
        return None

    yield write
    if unforeseen:
        raise unforeseen[0]
    if failed:
        raise InputError('; '.join(failed)) from next(iter(failed.values()))


def forget_standard_output() -> None:
    """Discard further standard output, which nobody reads, so that no later flush fails."""
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
    except (OSError, ValueError):  # standard output may be closed, or no file
        sys.stdout = open(os.devnull, 'w')
