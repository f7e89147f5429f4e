"""The changes of the payload that are worth reporting."""

from __future__ import annotations

from dataclasses import replace

from flex_payload_estimator.estimators.base import Event
from flex_payload_estimator.estimators.rpe.competition import SAME_CHANGE_S
from flex_payload_estimator.estimators.rpe.filter import Filter
from flex_payload_estimator.estimators.rpe.trial import Trial

# A change counts from so many standard deviations on, and from this share of (m + soft mass) on.
DEVIATIONS, SHARE = 4.0, 0.03


class EventLog:
    """The changes found so far; the last one is kept up to date, or taken back."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self._reported: Trial | None = None

    def update(self, reported: Trial | None, ongoing: Trial | None, incumbent: Filter,
               time: float, soft_mass: float) -> None:
        """
        Take what is known after a sample.

        Parameters
        ----------
        reported, ongoing : Trial or None
            The change that may be reported, and the one that goes on; see ModeCompetition.
        incumbent : Filter
            After the sample.
        time, soft_mass : float
            s and kg.

        """
        if self._reported is not None and ongoing in (None, self._reported):
            self._bring_up_to_date(incumbent.mass, soft_mass)
        if reported is None or reported is self._reported:
            return
        change = incumbent.mass - reported.mass_before
        if abs(change) <= max(DEVIATIONS * incumbent.variance**0.5,
                              SHARE * (reported.mass_before + soft_mass)):
            return
        self._reported = reported
        if not self.events or not self._continues(self.events[-1], reported, change):
            self.events.append(Event(reported.since, time, reported.mass_before, incumbent.mass))

    def _bring_up_to_date(self, mass: float, soft_mass: float) -> None:
        """Give the last change the payload of now, kg; take back one that changed nothing."""
        last = self.events[-1]
        if abs(mass - last.before) > SHARE * (last.before + soft_mass):
            self.events[-1] = replace(last, after=mass)
        else:
            self.events.pop()
            self._reported = None

    @staticmethod
    def _continues(last: Event, trial: Trial, change: float) -> bool:
        """Tell whether a change is the last one, going on after it seemed to be over."""
        return trial.since - last.found < SAME_CHANGE_S \
            and change * (last.after - last.before) > 0.0
