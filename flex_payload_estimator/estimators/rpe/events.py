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
        self._told: Trial | None = None

    def follow(self, change: Trial | None, moved: Trial | None, incumbent: Filter, time: float,
               soft: float) -> None:
        """
        Take what is known after a sample.

        Parameters
        ----------
        change, moved : Trial or None
            Of a walking payload, see Modes.
        incumbent : Filter
            Of this sample.
        time, soft : float
            s, and soft mass, kg.

        """
        if self._told is not None and moved in (None, self._told):
            self.events[-1] = replace(self.events[-1], after=incumbent.mass)
        if change is None or change is self._told:
            return
        apart = abs(incumbent.mass - change.mass)
        if apart > max(DEVIATIONS * incumbent.variance**0.5, SHARE * (change.mass + soft)):
            self.events.append(Event(change.since, time, change.mass, incumbent.mass))
            self._told = change
