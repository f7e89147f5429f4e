"""A regular file that stalls whoever opens it, as a network drive that is away does."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import fcntl
from pathlib import Path
import signal
import time
from typing import Any

TIMEOUT = 60.0  # s


@contextmanager
def held(path: Path) -> Iterator[Callable[[], None]]:
    """
    Make a file that another process cannot open inside the block; give what waits for one to try.

    The kernel lets it wait for /proc/sys/fs/lease-break-time, 45 s.
    """
    tried: list[Any] = []
    former = signal.signal(signal.SIGIO, lambda *_: tried.append(True))

    def wait() -> None:
        end = time.monotonic() + TIMEOUT
        while not tried:
            assert time.monotonic() < end, f'nobody opened {path}'
            time.sleep(0.01)

    path.touch()
    try:
        with path.open('rb') as file:
            fcntl.fcntl(file, fcntl.F_SETLEASE, fcntl.F_WRLCK)
            yield wait
    finally:
        signal.signal(signal.SIGIO, former)
