"""Stamps that must go on: new, repeated, stale, leaping ahead, or begun again."""

from __future__ import annotations

from enum import Enum

# In a second.
NANOSECONDS = 1_000_000_000
# A pause that a recorder or a busy machine makes is shorter than this; a clock that is set is not.
LEAP = NANOSECONDS
# Samples that may be lost without a doubt of the next one's stamp, as many as logs bridge.
LOST = 3


class Order(Enum):
    """What a stamp is, after those before it."""

    NEW = 'new'
    REPEATED = 'repeated'
    STALE = 'stale'
    AHEAD = 'ahead'
    RESTARTED = 'restarted'


def sane_stamp(seconds: int, nanoseconds: int) -> bool:
    """Return whether a header's stamp is a time."""
    return seconds >= 0 and 0 <= nanoseconds < NANOSECONDS


class StampOrder:
    """
    Tells new samples from repeated and stale ones, and from a time that began again.

    A sample further ahead than LOST samples, or from the past, says nothing alone: the next one
    may be where it belongs. A second one that goes on from it, or repeats it, is believed: after
    a pause of less than LEAP as new, else the source began again there (a bag that loops, a
    simulation that was reset, a clock that was set). What is stale by less than LOST samples
    only repetition makes believable: a time that goes on will pass it.

    Attributes
    ----------
    interval : int
        Between samples, ns.
    last : int or None
        The last stamp taken, ns.

    """

    def __init__(self, interval: int):
        self.interval = interval
        self.clear()

    def clear(self) -> None:
        """Take whatever comes next."""
        self.last: int | None = None
        self._suspect: int | None = None

    def judge(self, stamp: int, held_up: bool = False) -> Order:
        """
        Return what a stamp is, ns; new and restarted ones become the last.

        Where this side was held up, it may have lost the samples itself for less than LEAP.
        """
        if stamp == self.last:
            return Order.REPEATED
        gap = LEAP if held_up else (LOST + 1) * self.interval
        if self.last is None or 0 < stamp - self.last <= gap:
            order = Order.NEW
        elif self._confirmed(stamp, self.last):
            order = Order.NEW if self.last < stamp <= self.last + LEAP else Order.RESTARTED
        else:
            self._suspect = stamp
            return Order.STALE if stamp < self.last else Order.AHEAD
        self.last, self._suspect = stamp, None
        return order

    def _confirmed(self, stamp: int, last: int) -> bool:
        if self._suspect is None or stamp == self._suspect:
            return self._suspect is not None
        late = 0 < last - stamp <= LOST * self.interval
        return not late and 0 < stamp - self._suspect <= LEAP
