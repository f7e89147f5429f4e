"""A signal during the start ends a node quietly; imported before anything that takes time."""

from __future__ import annotations

from functools import partial
import os
import signal
import sys
from types import FrameType

# What a process ends with: as a shell says of Ctrl-C, and as asked.
CODES = {signal.SIGINT: 130, signal.SIGTERM: 0}


def end_at_once() -> None:
    """Let SIGINT and SIGTERM end the process without a word, unless they are ignored."""
    for number, code in CODES.items():
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, partial(_leave, code))


def _leave(code: int, _number: int, _frame: FrameType | None) -> None:
    # Nothing is half-written that is worth more than a quiet end; imports cannot be unwound.
    os._exit(code)


def open_what_is_closed() -> None:
    """
    Open /dev/null in place of standard streams that are closed, as some daemons' are.

    Else the next socket takes such a number, and what is written to stderr goes out on it; and
    rclpy's executor refuses to be made.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = sys.stdout or open(1, 'w', closefd=False)
    sys.stderr = sys.stderr or open(2, 'w', closefd=False)
