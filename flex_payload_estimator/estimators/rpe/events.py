"""Changes of the payload: which a walking payload is worth telling."""

from __future__ import annotations

from dataclasses import replace

from flex_payload_estimator.estimators.base import Event
from flex_payload_estimator.estimators.rpe.hypothesis import Filter
from flex_payload_estimator.estimators.rpe.modes import LASTS_S
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
        apart = incumbent.mass - change.mass
        if abs(apart) <= max(DEVIATIONS * incumbent.variance**0.5, SHARE * (change.mass + soft)):
            return
        self._told = change
        if not self.events or not self._goes_on(self.events[-1], change, apart):
            self.events.append(Event(change.since, time, change.mass, incumbent.mass))

    @staticmethod
    def _goes_on(last: Event, change: Trial, apart: float) -> bool:
        """Tell whether a change is the last one, going on after it seemed to be over."""
        return change.since - last.found < LASTS_S and apart * (last.after - last.before) > 0.0
