"""Keeps the payloads that come before their sample, and tells whether they come in time."""

from __future__ import annotations

import math

from msg_config.contract import COMMAND_TIMEOUT, load_topics

# Most payloads that are kept until their sample comes: as many as a publisher keeps.
MOST = load_topics()['payload/inertia'].qos.depth
# Payloads in time in a row after which samples wait again: at 100 Hz over TIMEOUT.
IN_TIME = 10
# Time without a payload in time after which diagnostics say so, s: as long as drives wait for a
# command. A single late payload does no harm.
TIMEOUT = COMMAND_TIMEOUT


class PayloadArrivals:
    """
    The payloads by the stamps of their samples; the last one serves where they come late.

    Attributes
    ----------
    late : bool
        Whether samples do not wait for their payload.
    early : dict
        Payloads that came before their sample, kg, by stamp, ns.
    last : float
        The last payload, kg; NaN before the first.

    """

    def __init__(self) -> None:
        self._in_time, self._heard_at = 0, -math.inf
        self.restart()

    def restart(self) -> None:
        """Forget all payloads, and wait for the next ones."""
        self.early: dict[int, float] = {}
        self.late, self.last = False, math.nan

    def keep(self, stamp: int, mass: float) -> None:
        """Keep a payload, kg, until the sample of its stamp, ns, comes."""
        self.early[stamp] = mass
        if len(self.early) > MOST:
            del self.early[min(self.early)]

    def overtaken(self) -> float:
        """
        Return the last payload, kg, for a sample that the next one has overtaken.

        From then on samples do not wait, and payloads in time are counted anew.
        """
        self.late, self._in_time = True, 0
        return self.last

    def take(self, stamp: int, now: float) -> float:
        """Return the payload for a sample at a stamp, ns, or the last one, kg; `now` in s."""
        if stamp in self.early:
            self.count(True, now)
        return self.early.pop(stamp, self.last)

    def count(self, in_time: bool, now: float) -> None:
        """Count payloads in time, now, s; after IN_TIME in a row samples wait again."""
        self._in_time = self._in_time + 1 if in_time else 0
        self._heard_at = now if in_time else self._heard_at
        self.late = self.late and self._in_time < IN_TIME

    def missing(self, now: float) -> bool:
        """Return whether none has come in time for TIMEOUT; `now` in s."""
        return self.late and now - self._heard_at > TIMEOUT
