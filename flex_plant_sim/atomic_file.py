"""Files that appear whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import shutil
from tempfile import TemporaryDirectory

from msg_config.errors import InputError


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """
    Yield a temporary path beside `path` that takes its name when the block ends well.

    After an error or Ctrl-C nothing is left, and what stood at `path` before stays. The block
    may make a file, or a folder (which replaces only a folder that holds a bag).

    Raises
    ------
    InputError
        If nothing can be written there.

    """
    target = Path(path)
    _check_target(target)
    try:
        # Its name stays: writers take formats and names of parts from it.
        with TemporaryDirectory(prefix='.', suffix=f'.{target.name}', dir=target.parent) as folder:
            yield Path(folder) / target.name
            if target.is_dir():
                shutil.rmtree(target)
            os.replace(Path(folder) / target.name, target)
    except OSError as error:
        raise InputError(f'{target}: expected a writable place, got: {error}') from None


def _check_target(target: Path) -> None:
    if not target.parent.is_dir():
        raise InputError(f'{target}: expected an existing folder, got {str(target.parent)!r}')
    if target.is_dir() and not (target / 'metadata.yaml').is_file():
        raise InputError(f'{target}: expected a file or a bag to replace, got a folder')
