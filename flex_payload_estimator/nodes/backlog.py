"""Whether a node answers samples more slowly than they come."""

from __future__ import annotations

import math


class Backlog:
    """
    Tells when a node must pass samples over to answer the newest.

    What waits after a stall grows less as it is answered, however much it was. Where the node is
    too slow it grows: left to itself the queue would lose one sample here and there for ever, and
    all answers be late. So where samples wait longer than the patience, and so much later no
    less, all that waits is passed over in a row.

    Parameters
    ----------
    patience : float
        How late an answer may be, s; at most half of what the queue holds.
    interval : float
        T, s.

    """

    def __init__(self, patience: float, interval: float):
        self._patience, self._caught_up = patience, interval
        self._since, self._then, self._passing = math.inf, 0.0, False

    def held_up(self, waited: float) -> bool:
        """Return whether samples may have been lost here before one that waited so long, s."""
        return waited > self._patience

    def passes(self, waited: float, now: float) -> bool:
        """Return whether a sample that waited, s, is to be passed over at a time, s."""
        if self._passing:
            self._passing = waited > self._caught_up
        elif not self.held_up(waited):
            self._since = math.inf
        elif self._since == math.inf:
            self._since, self._then = now, waited
        elif now - self._since > self._patience:
            self._passing = waited >= self._then
            self._since, self._then = now, waited
        if self._passing:
            self._since = math.inf
        return self._passing
