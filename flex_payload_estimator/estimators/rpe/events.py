"""Changes of the payload: which a walking payload is worth telling."""

from __future__ import annotations

from dataclasses import replace

from flex_payload_estimator.estimators.base import Event
from flex_payload_estimator.estimators.rpe.hypothesis import Filter
from flex_payload_estimator.estimators.rpe.trial import Trial

# A change counts from this many standard deviations, and this share of (m + soft mass).
DEVIATIONS, SHARE = 4.0, 0.03


class EventLog:
    """The changes found so far; the last one's mass afterwards is kept up to date."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self._open: Trial | None = None

    def follow(self, moved: Trial | None, incumbent: Filter, time: float, soft: float) -> None:
        """
        Take what is known after a sample.

        Parameters
        ----------
        moved : Trial or None
            The trial of a walking payload that has won, and is not over.
        incumbent : Filter
            Of this sample.
        time, soft : float
            s, and soft mass, kg.

        """
        if self._open is not None:
            self.events[-1] = replace(self.events[-1], after=incumbent.mass)
        if moved is None or moved is self._open:
            self._open = moved
            return
        change = abs(incumbent.mass - moved.mass)
        if change > max(DEVIATIONS * incumbent.variance**0.5, SHARE * (moved.mass + soft)):
            self.events.append(Event(moved.since, time, moved.mass, incumbent.mass))
            self._open = moved
