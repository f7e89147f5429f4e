"""Turns a signal into the end of a running node, which can still say something before it ends."""

from __future__ import annotations

from collections.abc import Callable
import os
import signal
from threading import Thread

from msg_config.quiet_start import CODES, ended_by


def end_on_signal(end: Callable[[int], None]) -> None:
    """
    Call `end` with the number of the first signal, in another thread, from now on.

    rclpy's own handlers shut its context down first, after which nothing can be published. A
    handler of Python runs only once the main thread is back from compiled code, where an executor
    waits; so the signal is passed on by a pipe. The second one ends the process at once.
    """
    read, write = os.pipe()
    os.set_blocking(write, False)
    signal.set_wakeup_fd(write, warn_on_full_buffer=False)
    for number in ended_by():
        signal.signal(number, _pass_on)
    Thread(target=_listen, args=(read, end), daemon=True).start()


def _pass_on(_number: int, _frame: object) -> None:
    # The number is in the pipe already; without a handler nothing would be written there.
    pass


def _listen(read: int, end: Callable[[int], None]) -> None:
    """Take the signals, one byte each."""
    asked = False
    while number := os.read(read, 1):
        if number[0] not in CODES:
            continue
        if asked:
            os._exit(CODES[number[0]])
        asked = True
        end(number[0])
