"""
Writes files so that they appear whole or not at all.

Every output of the tools goes through here. Only an output with their mark is replaced by a later
one; files that people go on editing, as robot files, have none.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
import os
from pathlib import Path
import re
import shutil
import stat
from tempfile import TemporaryDirectory

from flex_plant_sim.quiet_signals import held_back
from msg_config.errors import InputError

AUTHOR = 'flex_payload'
# Mark of a written file, in comments, image metadata, HTML or JSON near its start or end.
MARK = f'written by {AUTHOR}'
MARK_PATTERN = re.compile(rb'written.by\W{0,4}' + AUTHOR.encode())
# Number of bytes at either end of a file in which the mark is looked for.
MARK_RANGE = 8192
# Name of the file that carries the mark in a folder that was written whole.
SUMMARY = 'summary.json'
SYSTEM_FOLDERS = ('/dev', '/proc', '/sys')


@contextmanager
def whole_file(path: str | Path, folder: bool = False, known: bool = False) -> Iterator[Path]:
    """
    Yield a temporary path beside `path`, which is renamed to `path` if the block succeeds.

    After an error or Ctrl-C nothing is left of it, and an earlier file at `path` is unchanged.
    Where the block writes MARK, near the start or end of a file or in the SUMMARY of a folder, the
    output may be replaced later; one that people edit gets no mark, so that nothing replaces it.

    Parameters
    ----------
    path : str or Path
        Path of the output.
    folder : bool
        Whether the output is a folder; it may then replace an earlier folder, else an earlier
        file.
    known : bool
        Whether the caller knows, without the mark, that it wrote the earlier output.

    Raises
    ------
    InputError
        Nothing can be written there, or the path exists and was not written by these tools.

    """
    target = Path(os.path.realpath(path))
    check_replaceable(path, folder, known)
    try:
        # The file keeps its name, since writers take the format and names of parts from it.
        with TemporaryDirectory(prefix='.', suffix=f'.{target.name[-60:]}',
                                dir=target.parent) as beside:
            yield Path(beside) / target.name
            with held_back():
                _replace(target, Path(beside) / target.name)
    except OSError as error:
        raise InputError(f'{path}: expected a writable place, got: {_reason(error)}') from None


def _replace(target: Path, new: Path) -> None:
    """Rename to the target; an earlier folder there comes back if that fails."""
    earlier = new.with_name('.replaced')
    if target.is_dir():
        os.replace(target, earlier)
    try:
        os.replace(new, target)
    except BaseException:  # noqa: B902  a Ctrl-C too
        if earlier.exists():
            os.replace(earlier, target)
        raise
    shutil.rmtree(earlier, ignore_errors=True)


@contextmanager
def made_folder(path: Path) -> Iterator[Path]:
    """
    Make a folder and its parents, where missing, for outputs that the block writes into it.

    After an error or Ctrl-C those that were made and hold nothing are removed.

    Raises
    ------
    InputError
        It cannot be made.

    """
    made = [place for place in (path, *path.parents) if not place.exists()]
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f'{path}: expected a folder to write to, got: {_reason(error)}') from None
    try:
        yield path
    except BaseException:  # noqa: B902  a Ctrl-C too
        with suppress(OSError):  # one that holds an output stays
            for place in made:
                place.rmdir()
        raise


def _reason(error: OSError) -> str:
    return error.strerror or str(error)


def check_name(path: str | Path) -> None:
    """Raise InputError for -, which is standard output elsewhere and would become a file."""
    if str(path) == '-':
        raise InputError('-: expected the name of a file or folder: - is not read as standard '
                         'output')


def check_replaceable(path: str | Path, folder: bool = False, known: bool = False) -> None:
    """
    Check that an output can be written and would replace only an output of these tools.

    Raises
    ------
    InputError
        It cannot be written, or would replace something else.

    """
    check_name(path)
    target = Path(os.path.realpath(path))
    try:
        if os.path.abspath(path).startswith(tuple(f'{folder}/' for folder in SYSTEM_FOLDERS)):
            raise InputError(f'{path}: expected a file to write, got a device or a pipe')
        if not target.parent.is_dir():
            raise InputError(f'{path}: expected an existing folder, got '
                             f'{str(target.parent)!r}')
        mode = target.stat().st_mode if target.exists() else None
        if mode is None:
            return
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise InputError(f'{path}: expected a file to write, got a device or a pipe')
        if target.is_dir() != folder or not (known or written_here(target)):
            what = 'folder' if target.is_dir() else 'file'
            raise InputError(f'{path}: expected a new place, or one of this tool to replace, got '
                             f'a {what} that it did not write; remove it or choose another name')
    except OSError as error:
        raise InputError(f'{path}: expected a writable place, got: {_reason(error)}') from None


def image_metadata(path: str | Path) -> dict[str, str | None]:
    """Return the metadata that mark an image, by its suffix: PNG, PDF or SVG."""
    return {'Software': MARK} if Path(path).suffix == '.png' else {'Creator': MARK}


def digest_of(path: Path) -> str:
    """Return a digest of a file's contents, by which a later run knows what it wrote."""
    return sha256(path.read_bytes()).hexdigest()


def written_here(path: Path) -> bool:
    """Return whether a file or folder has the mark of these tools, or is empty."""
    if not path.is_dir():
        return _has_mark(path, empty=True)
    summary = path / SUMMARY
    return not any(path.iterdir()) or (summary.is_file() and _has_mark(summary, empty=False))


def _has_mark(path: Path, empty: bool) -> bool:
    with open(path, 'rb') as file:
        size = os.fstat(file.fileno()).st_size
        head = file.read(MARK_RANGE)
        file.seek(max(size - MARK_RANGE, 0))
        tail = file.read(MARK_RANGE)
    return (empty and not size) or bool(MARK_PATTERN.search(head) or MARK_PATTERN.search(tail))
