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

# Exit codes: 130 after Ctrl-C and 129 after a closed terminal by the convention of shells; 0 after
# SIGTERM, a requested end.
CODES: dict[int, int] = {signal.SIGINT: 130, signal.SIGTERM: 0, signal.SIGHUP: 129}


def end_at_once() -> None:
    """Let the signals of CODES end the process without output, unless they are ignored."""
    for number in CODES:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, partial(_leave, CODES[number]))


def ended_by() -> list[int]:
    """Return the signals that end a running node: SIGHUP does not where nohup ignores it."""
    return [number for number in CODES
            if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN]


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
