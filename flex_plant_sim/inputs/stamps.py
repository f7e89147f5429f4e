"""
Classifies message stamps by their order: new, repeated, stale, ahead, or started again.

The nodes apply it to whole samples, so that none is filtered twice or out of order.
"""

from __future__ import annotations

from enum import Enum

from msg_config.time_stamp import NANOSECONDS

# A jump of the stamps, ns. A pause of a recorder or of a busy machine is shorter; a clock that is
# set jumps further.
TIME_JUMP = NANOSECONDS
# Samples that may be lost in a row before the next stamp is doubted: as many as logs interpolate.
LOST = 3


class Order(Enum):
    """The kind of a stamp, judged by the stamps before it."""

    NEW = 'new'
    REPEATED = 'repeated'
    STALE = 'stale'
    AHEAD = 'ahead'
    RESTARTED = 'restarted'


class StampOrder:
    """
    Tells new samples from repeated and stale ones, and recognises a time that started again.

    A single stamp further ahead than LOST samples, or in the past, is not believed, since the
    next one may be in order again. A second stamp that continues from it, or repeats it, confirms
    it: as new after a pause of less than TIME_JUMP, otherwise as a restart of the source (a bag
    that loops, a simulation that was reset, a clock that was set). A stamp at most LOST samples in
    the past is confirmed only by its repetition, because a time that runs on will soon pass it.

    Attributes
    ----------
    interval : int
        Time between samples, ns.
    last : int or None
        The last stamp accepted, ns.

    """

    def __init__(self, interval: int):
        self.interval = interval
        self.clear()

    def clear(self) -> None:
        """Forget the last stamp, so that the next one is new whatever it is."""
        self.last: int | None = None
        self._suspect: int | None = None

    def judge(self, stamp: int, held_up: bool = False) -> Order:
        """
        Return the kind of a stamp, ns; new and restarted stamps become the last one.

        `held_up` says that the receiver itself was busy: it may then have lost samples, and a
        gap of up to TIME_JUMP is accepted.
        """
        if stamp == self.last:
            return Order.REPEATED
        gap = TIME_JUMP if held_up else (LOST + 1) * self.interval
        if self.last is None or 0 < stamp - self.last <= gap:
            order = Order.NEW
        elif self._confirmed(stamp, self.last):
            order = Order.NEW if self.last < stamp <= self.last + TIME_JUMP else Order.RESTARTED
        else:
            self._suspect = stamp
            return Order.STALE if stamp < self.last else Order.AHEAD
        self.last, self._suspect = stamp, None
        return order

    def expected(self, order: Order) -> str:
        """Return in words which stamps are in order, where one of this order was not."""
        last = f'after {(self.last or 0) / NANOSECONDS:.12g} s'
        most = (LOST + 1) * self.interval / NANOSECONDS
        return f'one at most {most:.3g} s {last}' if order is Order.AHEAD else f'one {last}'

    def _confirmed(self, stamp: int, last: int) -> bool:
        if self._suspect is None or stamp == self._suspect:
            return self._suspect is not None
        late = 0 < last - stamp <= LOST * self.interval
        return not late and 0 < stamp - self._suspect <= TIME_JUMP
