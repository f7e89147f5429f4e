"""The output folder of flex_demo: written whole, and replaced only as a demo left it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import json
from pathlib import Path

from flex_plant_sim.atomic_file import digest_of, SUMMARY, whole_file
from flex_plant_sim.tools.outputs import check_outputs
from msg_config.errors import InputError

# Key of the summary for what the demo wrote: file to digest.
DIGESTS = 'sha256'


@contextmanager
def whole_folder(path: Path, read: Sequence[str | Path]) -> Iterator[Path]:
    """
    Yield a new folder, which is renamed to `path` when the block ends without an error.

    Raises
    ------
    InputError
        `path` is something else than an earlier demo's output, or holds a file that is `read`, or
        nothing can be written there.

    """
    check_outputs({'--out': path}, read, folder=True)
    foreign = _foreign(path)
    if foreign:
        raise InputError(f'--out: {path}: expected a new folder or an output of flex_demo alone, '
                         f'got one with {foreign}')
    with whole_file(path, folder=True) as new:
        new.mkdir()
        yield new


def _foreign(folder: Path) -> str:
    """Return the first file of a folder that is not as a demo wrote it; empty if there is none."""
    if not folder.is_dir():
        return folder.name if folder.exists() else ''
    try:
        known = json.loads((folder / SUMMARY).read_bytes())[DIGESTS]
    except (OSError, ValueError, LookupError, TypeError):
        known = None
    known = known if isinstance(known, dict) else {}
    return next((name for name, digest in digests(folder).items()
                 if known.get(name) != digest), '')


def digests(folder: Path) -> dict[str, str]:
    """Return the digest of each file in a folder but the summary, by its name there."""
    return {str(path.relative_to(folder)): digest_of(path) for path in sorted(folder.rglob('*'))
            if path.is_file() and path != folder / SUMMARY}
