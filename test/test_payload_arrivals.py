"""Payloads that come in time or late: when samples wait for them."""

from __future__ import annotations

from flex_payload_estimator.nodes.payload_arrivals import IN_TIME, PayloadArrivals, TIMEOUT
import pytest


@pytest.mark.parametrize('before', [0, 3, 200])
def test_one_lost_payload_has_samples_wait_again_after_ten_in_time(before: int) -> None:
    payloads = PayloadArrivals()
    for k in range(before):
        payloads.count(True, 0.01 * k)
    payloads.last = 0.2
    assert payloads.overtaken() == 0.2
    for k in range(IN_TIME):
        assert payloads.late, f'after {k} in time'
        payloads.count(True, 0.01 * (before + k))
    assert not payloads.late


def test_a_late_one_among_those_in_time_begins_the_count_again() -> None:
    payloads = PayloadArrivals()
    payloads.overtaken()
    for k in range(2 * IN_TIME - 1):
        payloads.count(k != IN_TIME - 1, 0.01 * k)
        assert payloads.late
    payloads.count(True, 0.2)
    assert not payloads.late
    assert not payloads.missing(10.0), 'samples wait'


def test_none_in_time_for_long_is_missing() -> None:
    payloads = PayloadArrivals()
    payloads.count(True, 1.0)
    payloads.overtaken()
    assert not payloads.missing(1.0 + 0.9 * TIMEOUT)
    assert payloads.missing(1.0 + 1.1 * TIMEOUT)
