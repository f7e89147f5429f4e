"""
Handles Ctrl-C, SIGTERM and SIGHUP, of a terminal that closes, in the tools, at any moment.

A tool ends without a traceback, with exit code 130, and leaves no incomplete file.
"""

from __future__ import annotations

from contextlib import contextmanager
import os
import signal
import sys

# In place of typing.TYPE_CHECKING: a signal while typing is imported would end in a traceback.
MYPY = False

if MYPY:
    from collections.abc import Iterator
    from sys import UnraisableHookArgs
    from types import FrameType
    from typing import NoReturn

# Exit code by the convention of shells: 128 plus the number of SIGINT.
INTERRUPTED = 130
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# Time, s, after which an interrupt is repeated that a destructor or callback has swallowed: that
# code is then over.
REPEAT_DELAY = 0.01


def quiet_until_running() -> None:
    """
    Let a signal end this process at once and quietly.

    This is for the time of imports, or after the work is done, when there is nothing to clean up.
    """
    for number in SIGNALS:
        if signal.getsignal(number) in (signal.default_int_handler, signal.SIG_DFL):
            signal.signal(number, _leave)


def _leave(number: int, frame: FrameType | None) -> NoReturn:
    # In a child of multiprocessing, the parent writes the message.
    if 'multiprocessing.spawn' not in sys.modules and '--multiprocessing-fork' not in sys.argv:
        os.write(2, b'interrupted\n')
    os._exit(INTERRUPTED)


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


def _interrupt_again(unraisable: UnraisableHookArgs) -> None:
    """Repeat an interrupt that a destructor or a library's callback has swallowed."""
    if issubclass(unraisable.exc_type, KeyboardInterrupt):
        signal.signal(signal.SIGALRM, _interrupt)
        signal.setitimer(signal.ITIMER_REAL, REPEAT_DELAY)
    else:
        sys.__unraisablehook__(unraisable)


@contextmanager
def interruptible() -> Iterator[None]:
    """
    Turn the signals into KeyboardInterrupt inside the block, if in the main thread.

    One that is ignored stays so: under nohup a tool outlives its terminal.
    """
    hook = sys.unraisablehook
    try:
        before = [(number, signal.signal(number, _interrupt)) for number in SIGNALS
                  if signal.getsignal(number) is not signal.SIG_IGN]
        sys.unraisablehook = _interrupt_again
    except ValueError:  # not in the main thread, which handles the signals
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
    Delay signals that arrive inside the block until its end.

    A signal mask does not suffice: a thread of a library may take the signal, and the main thread
    is then interrupted wherever it is, or, in a forked process, not at all.
    """
    received: list[int] = []
    try:
        before = [(number, signal.signal(number, lambda n, frame: received.append(n)))
                  for number in SIGNALS]
    except ValueError:  # not in the main thread, which alone receives signals
        before = []
    try:
        yield
    finally:
        for number, handler in before:
            signal.signal(number, handler)
        if received:
            signal.raise_signal(received[0])
