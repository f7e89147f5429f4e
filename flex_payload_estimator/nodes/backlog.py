"""Decides when a node that is slower than its samples passes some of them over (`sample_node`)."""

from __future__ import annotations

import math


class Backlog:
    """
    Tells when a node must pass samples over to answer the newest.

    After a stall the backlog shrinks as it is answered, however large it was. Where the node is
    too slow it grows: left to itself the queue would drop one sample here and there for ever, and
    all answers would be late. So where samples wait longer than the patience, and no less one
    patience later, all samples that wait are passed over in a row.

    Parameters
    ----------
    patience : float
        How late an answer may be, s; at most half of what the queue holds.
    interval : float
        T, s; a sample that waited no longer has caught up.

    """

    def __init__(self, patience: float, interval: float):
        self._patience, self._caught_up = patience, interval
        self._since, self._then, self._passing = math.inf, 0.0, False

    def held_up(self, waited: float) -> bool:
        """Return whether a sample waited so long, s, that this node may have lost others."""
        return waited > self._patience

    def passes(self, waited: float, now: float) -> bool:
        """Return whether to pass over a sample that waited a time, s; `now` in s."""
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
