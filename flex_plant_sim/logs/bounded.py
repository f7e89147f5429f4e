"""Bounds the memory and disk space that reading a file from an untrusted source may take."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import resource

# Limits in bytes: of memory, and of a compressed bag once it is unpacked. A forged length or a
# decompression bomb takes more; half an hour at 200 Hz takes less.
MEMORY, FILE = 400_000_000, 1_000_000_000


def _in_use() -> int:
    """Return the size of the address space of this process, bytes."""
    with open('/proc/self/statm', encoding='ascii') as file:
        return int(file.read().split()[0]) * resource.getpagesize()


@contextmanager
def bounded() -> Iterator[None]:
    """
    Limit the block to MEMORY more bytes of memory and to files of at most FILE bytes.

    Exceeding them raises MemoryError or OSError. The limits apply to the whole process, with all
    its threads.
    """
    try:
        wanted = {resource.RLIMIT_AS: _in_use() + MEMORY, resource.RLIMIT_FSIZE: FILE}
    except OSError:  # not Linux: no bound
        wanted = {}
    before = {kind: resource.getrlimit(kind) for kind in wanted}
    for kind, limit in wanted.items():
        soft, hard = before[kind]
        known = [value for value in (soft, hard, limit) if value != resource.RLIM_INFINITY]
        resource.setrlimit(kind, (min(known), hard))
    try:
        yield
    finally:
        for kind, limits in before.items():
            resource.setrlimit(kind, limits)
