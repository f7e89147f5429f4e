"""Ctrl-C and SIGTERM at any moment: quiet, exit code 130, nothing half-written."""

from __future__ import annotations

from contextlib import contextmanager
import os
import signal
import sys

# Not typing's: a signal that comes while that is read would end in a traceback.
MYPY = False

if MYPY:
    from collections.abc import Iterator
    from sys import UnraisableHookArgs
    from types import FrameType
    from typing import NoReturn

# Exit code as shells have it: 128 and the number of SIGINT.
INTERRUPTED = 130
SIGNALS = (signal.SIGINT, signal.SIGTERM)
# After so long, s, what swallowed an interrupt is over.
AGAIN = 0.01


def quiet_until_running() -> None:
    """
    End this process quietly at a signal; for the time when it imports, or has done its work.

    Nothing is open then that would have to be undone.
    """
    for number in SIGNALS:
        if signal.getsignal(number) in (signal.default_int_handler, signal.SIG_DFL):
            signal.signal(number, _leave)


def _leave(number: int, frame: FrameType | None) -> NoReturn:
    # A child of multiprocessing leaves the word to its parent.
    if 'multiprocessing.spawn' not in sys.modules and '--multiprocessing-fork' not in sys.argv:
        os.write(2, b'interrupted\n')
    os._exit(INTERRUPTED)


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


def _interrupt_again(unraisable: UnraisableHookArgs) -> None:
    """Interrupt once more where a destructor or a library's callback has swallowed it."""
    if issubclass(unraisable.exc_type, KeyboardInterrupt):
        signal.signal(signal.SIGALRM, _interrupt)
        signal.setitimer(signal.ITIMER_REAL, AGAIN)
    else:
        sys.__unraisablehook__(unraisable)


@contextmanager
def interruptible() -> Iterator[None]:
    """Turn both signals into KeyboardInterrupt inside the block, where that can be done."""
    hook = sys.unraisablehook
    try:
        before = [(number, signal.signal(number, _interrupt)) for number in SIGNALS]
        sys.unraisablehook = _interrupt_again
    except ValueError:  # not in the main thread: whoever runs it there handles its signals
        before = []
    try:
        yield
    finally:
        sys.unraisablehook = hook
        if signal.getsignal(signal.SIGALRM) is _interrupt:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
        for number, handler in before:
            signal.signal(number, handler)


@contextmanager
def held_back() -> Iterator[None]:
    """
    Let signals that come inside the block be heard at its end, not in the middle.

    A mask would not do: a library's thread may take the signal, and the main thread then hears of
    it wherever it is, in a fork not at all.
    """
    heard: list[int] = []
    try:
        before = [(number, signal.signal(number, lambda n, frame: heard.append(n)))
                  for number in SIGNALS]
    except ValueError:  # not in the main thread, which is the one that hears
        before = []
    try:
        yield
    finally:
        for number, handler in before:
            signal.signal(number, handler)
        if heard:
            signal.raise_signal(heard[0])
