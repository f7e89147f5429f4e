"""Changes of the payload that are reported, and those that are not."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from flex_payload_estimator.estimators.rpe.events import EventLog

SOFT_MASS = 0.05


def filter_at(mass: float, deviation: float = 1e-4) -> Any:
    """Return what a log reads of a filter."""
    return SimpleNamespace(mass=mass, variance=deviation**2)


def trial_of(mass_before: float) -> Any:
    """Return what a log reads of a trial."""
    return SimpleNamespace(since=3.0, mass_before=mass_before)


def test_a_change_that_turns_out_to_be_none_is_taken_back() -> None:
    # An arm exactly as told, of another simulator, had "0.0801 -> 0.0799" in its list.
    log, trial = EventLog(), trial_of(0.08)
    log.update(trial, trial, filter_at(0.07), 3.1, SOFT_MASS)
    assert [(e.before, e.after) for e in log.events] == [(0.08, 0.07)]
    log.update(trial, trial, filter_at(0.06), 3.2, SOFT_MASS)
    assert log.events[-1].after == 0.06
    log.update(trial, None, filter_at(0.0799), 3.4, SOFT_MASS)
    assert log.events == []
    # What is more than so little again is told, once.
    for time, mass in ((3.5, 0.0798), (3.6, 0.06), (3.7, 0.061)):
        log.update(trial, None, filter_at(mass), time, SOFT_MASS)
    assert [(e.before, e.after) for e in log.events] == [(0.08, 0.061)]


def test_a_change_stays_where_the_payload_gets_less_sure() -> None:
    log, trial = EventLog(), trial_of(0.08)
    log.update(trial, trial, filter_at(0.04), 3.1, SOFT_MASS)
    log.update(None, None, filter_at(0.05, deviation=0.1), 9.0, SOFT_MASS)
    assert [(e.before, e.after) for e in log.events] == [(0.08, 0.05)]
