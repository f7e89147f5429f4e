"""Stamps that must go on: new, repeated, stale, leaping ahead, or begun again."""

from __future__ import annotations

from enum import Enum

NANOSECONDS = 1_000_000_000
# A pause that a recorder or a busy machine makes is shorter than this; a clock that is set is not.
LEAP = NANOSECONDS


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

    One sample from the past is stale, and one from beyond LEAP is ahead. A second one that goes
    on from it, or repeats it, means that the source began again there (a bag that loops, a
    simulation that was reset, a clock that was set, a source that paused).

    Attributes
    ----------
    last : int or None
        The last stamp taken, ns.

    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Take whatever comes next."""
        self.last: int | None = None
        self._suspect: int | None = None

    def judge(self, stamp: int) -> Order:
        """Return what a stamp is, ns; new and restarted ones become the last."""
        if stamp == self.last:
            return Order.REPEATED
        if self.last is None or self.last < stamp <= self.last + LEAP:
            order = Order.NEW
        elif self._suspect is not None and 0 <= stamp - self._suspect <= LEAP:
            order = Order.RESTARTED
        else:
            self._suspect = stamp
            return Order.STALE if stamp < self.last else Order.AHEAD
        self.last, self._suspect = stamp, None
        return order
