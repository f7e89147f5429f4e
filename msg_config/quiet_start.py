"""
Lets a signal during the start end a node quietly.

It is imported before anything that takes time.
"""

from __future__ import annotations

from functools import partial
import os
import signal
import sys
from types import FrameType

# Exit codes: 130 after Ctrl-C by the convention of shells; 0 after SIGTERM, a requested end.
CODES = {signal.SIGINT: 130, signal.SIGTERM: 0}


def end_at_once() -> None:
    """Let SIGINT and SIGTERM end the process without output, unless they are ignored."""
    for number, code in CODES.items():
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, partial(_leave, code))


def _leave(code: int, _number: int, _frame: FrameType | None) -> None:
    # At the start no output is incomplete yet, and interrupted imports cannot be undone.
    os._exit(code)


def open_what_is_closed() -> None:
    """
    Open /dev/null in place of closed standard streams, as some daemons have them.

    Otherwise the next socket gets their file number, and text for stderr is sent on it; besides,
    rclpy cannot create its executor.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = sys.stdout or open(1, 'w', closefd=False)
    sys.stderr = sys.stderr or open(2, 'w', closefd=False)
