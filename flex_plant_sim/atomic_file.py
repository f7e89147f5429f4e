"""Files that appear whole or not at all, and replace nothing that these tools did not write."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import re
import shutil
import stat
from tempfile import TemporaryDirectory

from msg_config.errors import InputError

AUTHOR = 'flex_payload'
# Comments, image metadata, HTML and JSON carry it near their start or their end.
MARK = f'written by {AUTHOR}'
MARKED = re.compile(rb'written.by\W{0,4}' + AUTHOR.encode())
# Bytes at either end of a file in which the mark stands.
WHERE = 8192
# In a folder that was written whole, the file that carries the mark.
SUMMARY = 'summary.json'
SYSTEM = ('/dev', '/proc', '/sys')


@contextmanager
def whole_file(path: str | Path, folder: bool = False, known: bool = False) -> Iterator[Path]:
    """
    Yield a temporary path beside `path` that takes its name when the block ends well.

    After an error or Ctrl-C nothing is left, and what stood at `path` before stays. What the
    block makes must bear MARK, or it is never replaced: a file near its start or end, a folder
    in its SUMMARY.

    Parameters
    ----------
    path : str or Path
        Where the file shall stand.
    folder : bool
        Whether an earlier folder may be replaced, else an earlier file.
    known : bool
        Whether the caller knows, without the mark, that it wrote what stands there.

    Raises
    ------
    InputError
        If nothing can be written there, or something stands there that was not written so.

    """
    target = Path(os.path.realpath(path))
    check_replaceable(path, folder, known)
    try:
        # Its name stays: writers take formats and names of parts from it.
        with TemporaryDirectory(prefix='.', suffix=f'.{target.name[-60:]}',
                                dir=target.parent) as beside:
            yield Path(beside) / target.name
            if target.is_dir():
                os.replace(target, Path(beside) / '.replaced')
            os.replace(Path(beside) / target.name, target)
            shutil.rmtree(Path(beside) / '.replaced', ignore_errors=True)
    except OSError as error:
        raise InputError(f'{path}: expected a writable place, got: {_reason(error)}') from None


def _reason(error: OSError) -> str:
    return error.strerror or str(error)


def check_replaceable(path: str | Path, folder: bool = False, known: bool = False) -> None:
    """
    Raise where an output cannot be, or would replace what these tools did not write.

    Raises
    ------
    InputError

    """
    target = Path(os.path.realpath(path))
    try:
        if os.path.abspath(path).startswith(SYSTEM):
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
    """Return the mark of these tools as an image of that suffix holds it: PNG, PDF, SVG."""
    return {'Software': MARK} if Path(path).suffix == '.png' else {'Creator': MARK}


def written_here(path: Path) -> bool:
    """Return whether a file or folder bears the mark of these tools, or is empty."""
    if not path.is_dir():
        return _marked(path, empty=True)
    summary = path / SUMMARY
    return not any(path.iterdir()) or (summary.is_file() and _marked(summary, empty=False))


def _marked(path: Path, empty: bool) -> bool:
    with open(path, 'rb') as file:
        size = os.fstat(file.fileno()).st_size
        head = file.read(WHERE)
        file.seek(max(size - WHERE, 0))
        return (empty and not size) or bool(MARKED.search(head) or MARKED.search(file.read(WHERE)))
