"""Samples out of messages: parts that share a stamp, and stamps that must go on."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import Any

PENDING = 10


class Pairing:
    """
    Collects the parts of a sample until all that bear one stamp are there.

    The parts may come in any order, twice, or never; at most PENDING samples wait.

    Parameters
    ----------
    parts : sequence of str
        Their names.

    """

    def __init__(self, parts: Sequence[str]):
        self._parts = len(parts)
        self._pending: dict[int, dict[str, Any]] = {}

    def clear(self) -> None:
        """Forget what waits."""
        self._pending.clear()

    def add(self, part: str, stamp: int, value: Any) -> dict[str, Any] | None:
        """
        Return the whole sample of a stamp if this was its last part.

        What began to arrive before a whole sample is given up: its missing part was lost.
        """
        sample = self._pending.setdefault(stamp, {})
        sample[part] = value
        if len(sample) == self._parts:
            self._drop_up_to(stamp)
            return sample
        if len(self._pending) > PENDING:
            del self._pending[next(iter(self._pending))]
        return None

    def _drop_up_to(self, stamp: int) -> None:
        for earlier in list(self._pending):
            del self._pending[earlier]
            if earlier == stamp:
                return


class Order(Enum):
    """What a stamp is, after those before it."""

    NEW = 'new'
    REPEATED = 'repeated'
    STALE = 'stale'
    RESTARTED = 'restarted'


class StampOrder:
    """
    Tells new samples from repeated and stale ones, and from a time that began again.

    One sample from the past is stale. A second one that goes on from it, or repeats it, means
    that the source began again (a bag that loops, a simulation that was reset).

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
        if self.last is None or stamp > self.last:
            order = Order.NEW
        elif self._suspect is not None and stamp >= self._suspect:
            order = Order.RESTARTED
        else:
            self._suspect = stamp
            return Order.STALE
        self.last, self._suspect = stamp, None
        return order
