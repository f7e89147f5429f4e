"""A task for many items in several processes; an item that fails has no result."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, ExitStack
from functools import partial
from multiprocessing import get_context
import signal
from typing import Any, TypeVar

import numpy as np

Found = TypeVar('Found')


def each(task: Callable[[Any], Found], items: Sequence[Any], jobs: int,
         progress: Callable[[float], None] = lambda share: None) -> list[Found]:
    """Return what the task finds where it succeeds, in the order of the items."""
    found: list[Found] = []
    with ExitStack() as stack:
        if jobs <= 1 or len(items) < 2:
            results: Iterable[Found | None] = map(partial(attempt, task), items)
        else:
            with _interrupts_held():
                pool = stack.enter_context(get_context('fork').Pool(
                    jobs, initializer=_remember, initargs=(task,)))
            results = pool.imap(_run, items)
        for done, result in enumerate(results, start=1):
            progress(done / len(items))
            found += [result] if result is not None else []
    return found


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C back while workers start, who never get it: one in a fork would be lost."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def attempt(task: Callable[[Any], Found], item: Any) -> Found | None:
    """Return what the task finds, or None where the hypothesis makes no finite prediction."""
    try:
        return task(item)
    except np.linalg.LinAlgError:
        return None


# The pool's own copy of the task: set once in each worker process, so that the records are
# inherited and not sent with every item.
_worker: list[Callable[[Any], Any]] = []


def _remember(task: Callable[[Any], Any]) -> None:
    # The parent ends workers by SIGTERM, which means an interrupt to it alone.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    _worker[:] = [task]


def _run(item: Any) -> Any:
    return attempt(_worker[0], item)
