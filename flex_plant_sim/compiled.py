"""Numba where it is installed (the extra `speed`); the same code runs without it."""

from __future__ import annotations

from collections.abc import Callable
import os
from typing import Any, cast, TypeVar

try:
    from numba import njit
    COMPILED = os.environ.get('NUMBA_DISABLE_JIT', '0') in ('', '0')
except ImportError:
    COMPILED = False

Function = TypeVar('Function', bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Return the function compiled, once for each installation, or as it is."""
    return cast(Function, njit(cache=True)(function)) if COMPILED else function


def cold(function: Callable[..., Any]) -> bool:
    """Tell whether a compiled function's first call would compile, which can take a minute."""
    if not COMPILED:
        return False
    # Numba has no public word for it; a source that has changed since counts as not compiled.
    dispatcher: Any = function
    return not dispatcher._cache._cache_file._load_index()
