"""Reports in one line a memory limit (`ulimit -v`) that is too low to load the libraries."""

from __future__ import annotations

import os
import resource

from msg_config.errors import MACHINE

# Least address space, kB as in ulimit. With less, libraries are not found (300000), wait for
# memory for ever (350000) or abort (500000); with this much a log of 30 s can be estimated.
LEAST_KB = 600_000


def refuse_too_little() -> None:
    """End the process with one line and exit code 75 if the memory limit is too low."""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit // 1024 < LEAST_KB:
        os.write(2, (f'error: ulimit -v: expected at least {LEAST_KB}, '
                     f'got {limit // 1024}\n').encode())
        os._exit(MACHINE)
