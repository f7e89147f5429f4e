"""A payload that changes in the part of a record that is locked for the figures."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses
from flex_plant_sim.diagnosis.causes.neighbours import NeighbourFitter, with_event_times
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.causes.search import search
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import evenly, Record, Windows
from flex_plant_sim.diagnosis.verdict.late_event import (
    event_pays,
    locked_part_differs,
    log_odds_of_larger,
)
from flex_plant_sim.diagnosis.verdict.verdict import diagnose, nominal_base, slowest_frequency
from flex_plant_sim.effects import catalogue
import numpy as np
import pytest
from scipy.stats import t
from truth.records import draw_case, make_record

REFERENCE = load_robot('reference')
BASE = nominal_base(REFERENCE, 'assumed_modes', 2)
# s; coarse fits see few of the windows of a long record.
DURATION_S, LATE_S, LONG_S = 20.0, 17.0, 30.0
ASKED = ('payload_change', 'payload_mass', 'link_stiffness')
OTHERS = [name for name in catalogue() if name not in ASKED]
ALL_BUT_MASS = [*OTHERS, 'payload_change', 'link_stiffness']


@cache
def made(time_s: float | None, payload: float = 0.1, left: float = 0.03,
         duration_s: float = DURATION_S) -> Record:
    """Return the record of a finite-element arm whose payload changes at a time, s, or not."""
    hidden: dict[str, Any] = {} if time_s is None else {'effects': (
        ('payload_change', {'mass': left, 'time': time_s, 'duration': 0.0}),)}
    case = replace(draw_case(None, 780001, duration_s=duration_s), payload_true=payload,
                   payload_told=payload, **hidden)
    log = make_record(case)
    return Record('made', log.time, log.command, np.hstack([log.joint, log.strain]), payload)


def test_either_end_is_locked_and_the_rest_is_fitted() -> None:
    record = made(None)
    slowest = slowest_frequency(BASE, 0.1)
    for locks_first in (False, True):
        work, locked = Windows.cut(record, slowest, REFERENCE.sample_time, locks_first)
        samples = np.zeros(len(record.time), dtype=int)
        samples[locked.others] += 1
        for windows in (work, locked):
            assert windows.length == work.length
        scored = (work.starts[:, None] + np.arange(work.length)).ravel()
        assert np.all(samples[scored] == 1), 'laws are fitted to what is fitted'
        held = (locked.starts[:, None] + np.arange(locked.length)).ravel()
        assert np.all(samples[held] == 0)
        assert (held.min() < scored.min()) == locks_first


@pytest.mark.slow
def test_a_payload_that_changes_in_the_locked_part_is_named() -> None:
    found, data, extended = diagnose([made(LATE_S)], BASE, exclude=OTHERS)
    cause, = found.causes
    assert cause.name == 'payload_change' and found.verdict == 'cause'
    values = {v.name: v for v in cause.parameters}
    assert values['change_kg'].low < -0.07 < values['change_kg'].high < -0.05
    assert values['time_s'].value == pytest.approx(LATE_S, abs=0.1)
    # What judges the gain lies before the change, where no fit has been.
    assert data.locked[0].record.time[data.locked[0].starts[-1]] < 10.0
    assert [e.identifier for e in extended.effects].count('payload_change') == 1


@pytest.mark.parametrize('jitter', [0.0, 0.3])
def test_an_event_between_the_windows_of_a_coarse_fit_is_looked_for_there(jitter: float) -> None:
    """To a fit that sees eight windows, the end of one is as good as all that no window saw."""
    record, random = made(12.0, left=0.16, duration_s=LONG_S), np.random.default_rng(3)
    late = jitter * REFERENCE.sample_time * random.uniform(-1.0, 1.0, len(record.time))
    data = Data.of([replace(record, time=record.time + late)], slowest_frequency(BASE, 0.1),
                   REFERENCE.sample_time)
    centre = RefinedFit.refine(CandidateSet((), (np.zeros(0),)), BASE, data)
    seen = np.unique(centre.coarse.likelihood.times)
    before, after = np.max(seen[seen < 12.0]), np.min(seen[seen > 12.0])
    assert before < 11.0 and after > 13.0
    event = tuple(h for h in all_hypotheses(REFERENCE) if h.label == 'payload_change:arm')
    start = CandidateSet(event, (np.array([0.05, after + 0.1, 0.0]),))
    fitted = NeighbourFitter(centre.likelihood, centre.fit.error_scale, data.duration)
    stuck, found = fitted(start), fitted(with_event_times(start, centre))
    assert abs(stuck.values[1] - 12.0) > 1.0
    assert found.values[1] == pytest.approx(12.0, abs=0.2)
    assert found.log_evidence > stuck.log_evidence + 50.0


def test_what_changes_in_the_locked_part_and_has_no_name_is_not_nothing() -> None:
    found, data, _ = diagnose([made(LATE_S)], BASE, exclude=[*OTHERS, 'payload_change'])
    assert found.verdict != 'nothing_wrong' and found.effects['unknown'] > 0.5
    assert data.locked[0].record.time[data.locked[0].starts[-1]] < 10.0


def test_without_an_event_the_locked_part_is_like_the_rest() -> None:
    data = Data.of([made(None)], slowest_frequency(BASE, 0.1), REFERENCE.sample_time)
    nothing = search(data, BASE, 1, lambda step, share: None, ALL_BUT_MASS)
    assert not locked_part_differs(nothing, data)
    # A small change near the end: on the whole errors are still less than any model may make.
    for record in (made(LATE_S), made(18.7, left=0.07)):
        late = Data.of([record], slowest_frequency(BASE, 0.1), REFERENCE.sample_time)
        assert locked_part_differs(nothing, late)


def test_an_event_is_asked_for_beside_what_was_found() -> None:
    def seen(time_s: float | None, locks_first: bool) -> Data:
        record = replace(made(time_s), payload=0.14)
        return Data.of([record], slowest_frequency(BASE, 0.1), REFERENCE.sample_time, locks_first)
    found = search(seen(None, False), BASE, 1, lambda step, share: None, ALL_BUT_MASS)
    assert [h.effect.identifier for h in found.best.fit.hypotheses] == ['payload_mass']
    for time_s in (None, LATE_S):
        pays = event_pays(found, seen(time_s, True), BASE, 1, lambda step, share: None, OTHERS)
        assert pays == (time_s is not None)


@pytest.mark.parametrize(('size', 'every', 'expected'), [
    (7, 2, [0, 2, 4, 6]), (4, 2, [0, 3]), (4, 7, [0, 3]), (5, 1, [0, 1, 2, 3, 4]), (1, 3, [0])])
def test_the_first_and_the_last_window_are_among_those_that_are_looked_at(
        size: int, every: int, expected: list[int]) -> None:
    """What has changed in a record shows between its ends, however few windows are used."""
    assert evenly(size, every).tolist() == expected


@pytest.mark.parametrize(('size', 'every', 'expected'), [
    (8, 5, [0, 5, 7]), (8, 3, [0, 5, 7]), (8, 2, [0, 1, 5, 7]), (4, 1, [0, 1, 2, 3]),
    (2, 3, [0, 1]), (1, 3, [0])])
def test_the_busiest_windows_are_looked_at_first(size: int, every: int, expected: list[int]
                                                 ) -> None:
    """A limit that is met in one window in eight shows there alone."""
    command = np.zeros((10 * size, 2))
    command[::2, 0], command[51:60, 1] = 1e-3, 1.0
    time = 0.01 * np.arange(len(command), dtype=float)
    windows = Windows(Record('busy', time, command, np.zeros_like(command), 0.1),
                      10 * np.arange(size), 10, 0)
    assert windows.busiest(every).tolist() == expected


@pytest.mark.slow
def test_a_payload_that_drops_between_the_times_that_are_tried_is_named() -> None:
    """Most of a heavy payload falls off: from the nearest times tried, a fit ends elsewhere."""
    record = made(18.6, payload=0.28, left=0.04, duration_s=LONG_S)
    found, _, _ = diagnose([record], BASE, exclude=[n for n in OTHERS if n != 'strain_filter'])
    cause, = found.causes
    values = {v.name: v.value for v in cause.parameters}
    assert values['change_kg'] == pytest.approx(-0.24, abs=0.02)
    assert values['time_s'] == pytest.approx(18.6, abs=0.1)


def test_a_later_window_is_weighed_by_the_spread_of_the_earlier_ones() -> None:
    rng = np.random.default_rng(2)
    before, after = rng.normal(0.0, 0.5, (6, 5)), np.array([[-1.0, 2.0]] * 6)
    found = log_odds_of_larger(before, after, 0.01)
    deviation = np.sqrt(np.mean(np.var(before, axis=1, ddof=1)) * (1.0 + 1.0 / 5.0))
    steps = (2.0 - before.mean(axis=1)) / deviation
    assert found[:, 1] == pytest.approx(t.logpdf(0.0, 24) - t.logpdf(steps, 24))
    assert np.all(found[:, 0] == 0.0), 'what fits better is no event'
    wide = log_odds_of_larger(before, after, 100.0)[:, 1]
    assert np.all(wide < 0.1), 'windows are no surer than their samples are many'


def test_records_of_any_lengths_are_cut_into_equal_windows() -> None:
    long = made(None)
    short = replace(long, time=long.time[:1300], command=long.command[:1300],
                    output=long.output[:1300])
    data = Data.of([long, short], slowest_frequency(BASE, 0.1), REFERENCE.sample_time)
    assert len({windows.length for windows in (*data.windows, *data.locked)}) == 1
    found = search(data, BASE, 1, lambda step, share: None, ALL_BUT_MASS)
    assert not locked_part_differs(found, data)
