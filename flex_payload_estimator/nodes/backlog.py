"""Whether a node answers samples more slowly than they come."""

from __future__ import annotations

import math


class Backlog:
    """
    Tells when a node must pass samples over to answer the newest.

    A stall fills the queue of samples once, and what waits there is soon answered. Where samples
    go on waiting for half of what the queue holds, for as long again, the node is too slow: left
    to itself the queue would lose one sample here and there for ever, and all answers be late. So
    all that waits is passed over in a row.

    Parameters
    ----------
    room : float
        What the queue of samples holds, s.
    interval : float
        T, s.

    """

    def __init__(self, room: float, interval: float):
        self._patience, self._caught_up = 0.5 * room, interval
        self._since, self._passing = math.inf, False

    def held_up(self, waited: float) -> bool:
        """Return whether the queue may have lost samples before one that waited so long, s."""
        return waited > self._patience

    def passes(self, waited: float, now: float) -> bool:
        """Return whether a sample that waited, s, is to be passed over at a time, s."""
        if self._passing:
            self._passing = waited > self._caught_up
        elif not self.held_up(waited):
            self._since = math.inf
        else:
            self._since = min(self._since, now)
            self._passing = now - self._since > self._patience
        if self._passing:
            self._since = math.inf
        return self._passing
