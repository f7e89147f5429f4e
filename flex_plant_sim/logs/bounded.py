"""A bound on what a strange file may make a reader take of memory and disk."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import resource

# Bytes of memory, and of a compressed bag once unpacked. A length that was crafted, or a bomb,
# takes more; half an hour at 200 Hz takes less.
MEMORY, FILE = 400_000_000, 1_000_000_000


def _in_use() -> int:
    """Return the size of this process' address space, bytes."""
    with open('/proc/self/statm', encoding='ascii') as file:
        return int(file.read().split()[0]) * resource.getpagesize()


@contextmanager
def bounded() -> Iterator[None]:
    """
    Let the block take so much more MEMORY, and write files no longer than FILE.

    What exceeds it raises MemoryError or OSError. The bound is the process', all its threads'.
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
