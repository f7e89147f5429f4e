"""A task for many items in several processes; an item that fails has no result."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import ctypes
import gc
from multiprocessing import current_process
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkContext, ForkProcess
import time
from typing import Any, TypeVar

from flex_plant_sim.quiet_signals import held_back
import numpy as np

Found = TypeVar('Found')
# s between times at which a worker returns freed memory: what it returns it has to get again. (A
# bench record takes 0.63 million page faults for 1.05 without a pause, and 4 % less CPU time.)
RETURN_INTERVAL = 0.2
# Of glibc; other libraries of C have none.
_malloc_trim = getattr(ctypes.CDLL(None), 'malloc_trim', None)


def each(task: Callable[[Any], Found], items: Sequence[Any], jobs: int,
         progress: Callable[[float], None] = lambda share: None) -> list[Found]:
    """
    Return what the task finds where it succeeds, in the order of the items.

    A worker has none of its own: what it is asked for it does alone.
    """
    found: list[Found | None] = [None] * len(items)
    if jobs <= 1 or len(items) < 2 or current_process().daemon:
        for k, item in enumerate(items):
            found[k] = attempt(task, item)
            progress((k + 1) / len(items))
        return [result for result in found if result is not None]
    with _workers(task, items, min(jobs, len(items))) as pipes:
        for done, (k, result) in enumerate(_served(pipes, len(items)), start=1):
            found[k] = result
            progress(done / len(items))
    return [result for result in found if result is not None]


def all_of(task: Callable[[Any], Found], items: Sequence[Any], jobs: int,
           progress: Callable[[float], None] = lambda share: None) -> list[Found]:
    """
    Return what the task finds for each item.

    Raises
    ------
    LinAlgError
        Where it fails for one.

    """
    found = each(task, items, jobs, progress)
    if len(found) < len(items):
        raise np.linalg.LinAlgError('no finite prediction')
    return found


def attempt(task: Callable[[Any], Found], item: Any) -> Found | None:
    """Return what the task finds, or None where the hypothesis makes no finite prediction."""
    try:
        return task(item)
    except np.linalg.LinAlgError:
        return None


@contextmanager
def _workers(task: Callable[[Any], Any], items: Sequence[Any], count: int
             ) -> Iterator[list[Connection[Any, Any]]]:
    """
    Yield the pipes to workers, which are gone when the block is left, however it is left.

    Forked, so that the records are inherited and not sent. No thread is involved, and a worker
    whose parent is gone finds its pipe closed: nothing outlives an interrupt.
    """
    workers: list[ForkProcess] = []
    pipes: list[Connection[Any, Any]] = []
    try:
        _return_freed_memory()
        # Workers keep signals held back; they end by SIGKILL.
        with held_back():
            for _ in range(count):
                near, far = ForkContext().Pipe()
                pipes.append(near)
                worker = ForkContext().Process(
                    target=_work, args=(task, items, far, tuple(pipes)), daemon=True)
                worker.start()
                workers.append(worker)
                far.close()
        yield pipes
    finally:
        with held_back():
            for worker in workers:
                worker.kill()
                worker.join()
            for pipe in pipes:
                pipe.close()


def _served(pipes: Sequence[Connection[Any, Any]], count: int) -> Iterator[tuple[int, Any]]:
    """Hand out the numbers of items, one at a time; yield each with its result."""
    numbers = iter(range(count))
    for pipe, k in zip(pipes, numbers):
        pipe.send(k)
    for _ in range(count):
        pipe = next(p for p in wait(pipes) if isinstance(p, Connection))
        try:
            k, result, error = pipe.recv()
        except EOFError:
            raise MemoryError('a worker process was killed') from None
        if error is not None:
            raise error
        further = next(numbers, None)
        if further is not None:
            pipe.send(further)
        yield k, result


def _work(task: Callable[[Any], Any], items: Sequence[Any], pipe: Connection[Any, Any],
          others: Sequence[Connection[Any, Any]]) -> None:
    """Serve one pipe until the parent is gone; its own copies of the others' ends are closed."""
    # What the parent has left behind, handles of a middleware among it, is not to be freed here.
    gc.freeze()
    for other in others:
        other.close()
    returned = time.monotonic()
    try:
        while True:
            k = pipe.recv()
            try:
                pipe.send((k, attempt(task, items[k]), None))
                if time.monotonic() - returned > RETURN_INTERVAL:
                    _return_freed_memory()
                    returned = time.monotonic()
            except Exception as error:  # noqa: B902  the parent raises it
                pipe.send((k, None, error))
    except (EOFError, OSError):
        return


def _return_freed_memory() -> None:
    """
    Give freed memory back to the system.

    The allocator keeps what one item needed, and each worker would its own. On a record of 50 s
    at 500 Hz that was 110 MB in all of 700; it takes 493 MB now
    (`benchmarks/diagnosis_time.py --log`).
    """
    if _malloc_trim is not None:
        _malloc_trim(0)
