"""Whether a node answers samples more slowly than they come."""

from __future__ import annotations

import math

# So many samples may wait for an answer: half a second at 100 Hz, a twentieth at 1 kHz.
WAITING = 50


class Backlog:
    """
    Tells when a node must pass samples over to answer the newest.

    What waits after a stall grows less as it is answered, however much it was. Where the node is
    too slow it grows: left to itself the queue would lose one sample here and there for ever, and
    all answers be late. So where more than WAITING wait, and not fewer that many samples later,
    all that waits is passed over in a row.

    Parameters
    ----------
    interval : float
        T, s.

    """

    def __init__(self, interval: float):
        self._patience, self._caught_up = WAITING * interval, interval
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
