"""Compiles inner loops with Numba if it is installed (the extra `speed`); else they run as is."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
import hashlib
import os
from pathlib import Path
import re
import sys
from typing import Any, cast, TypeVar

try:
    from numba import njit
    COMPILED = os.environ.get('NUMBA_DISABLE_JIT', '0') in ('', '0')
except ImportError:
    COMPILED = False

COMPILING = 'compiling the inner loops (once for each installation, one to three minutes) …'
# A source whose functions are compiled, or become part of what is.
HAS_LOOPS = re.compile(rb'^from flex_plant_sim\.compiled import (COMPILED, )?compiled$', re.M)
Function = TypeVar('Function', bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Return the function compiled; the result is cached until a source file changes."""
    if not COMPILED:
        return function
    dispatcher: Any = njit(cache=True)(function)
    # Numba only checks the function's own file, but the functions that it calls are compiled into
    # it.
    index = dispatcher._cache._cache_file
    index._source_stamp = index._source_stamp, loops_digest(function.__module__.partition('.')[0])
    return cast(Function, dispatcher)


@lru_cache
def loops_digest(package: str) -> str:
    """Return a digest of all sources with compiled loops, of this package and another."""
    found, here = hashlib.sha256(), Path(__file__).parent
    for folder in sorted({here, here.parent / package}):
        for path in sorted(folder.rglob('*.py')):
            source = path.read_bytes()
            if HAS_LOOPS.search(source):
                found.update(source)
    return found.hexdigest()


def cold(function: Callable[..., Any]) -> bool:
    """Return whether the first call of a function would compile it, which can take a minute."""
    if not COMPILED:
        return False
    # Numba has no public function for this. A changed source counts as not compiled.
    dispatcher: Any = function
    return not dispatcher._cache._cache_file._load_index()


def say_if_compiling(function: Callable[..., Any]) -> None:
    """Print a line to stderr if calling a function is about to compile it."""
    if cold(function):
        print(COMPILING, file=sys.stderr, flush=True)
