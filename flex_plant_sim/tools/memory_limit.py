"""A limit of memory below which the libraries cannot be loaded is said in one line."""

from __future__ import annotations

import os
import resource

# kB of address space, as ulimit has it. Below, libraries cannot be found (300000), wait for room
# for ever (350000) or abort (500000); with it a log of 30 s is estimated.
LEAST = 600_000


def refuse_too_little() -> None:
    """End with one line and code 2 below a `ulimit -v` at which nothing can be loaded."""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit // 1024 < LEAST:
        os.write(2, f'error: ulimit -v: expected at least {LEAST}, got {limit // 1024}\n'.encode())
        os._exit(2)
