"""Samples out of messages: finite numbers, and the order of stamps."""

from __future__ import annotations

from flex_plant_sim.inputs.stamps import Order, StampOrder
from msg_config.errors import InputError
import numpy as np
import pytest


@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_named(bad: float) -> None:
    from msg_config.messages import check_finite

    check_finite(np.array([1e308, 1e308]), ('a', 'b'), 'strain: position')
    with pytest.raises(InputError, match=f'strain: position of b: expected a finite number, '
                                         f'got {bad}'):
        check_finite(np.array([1.0, bad]), ('a', 'b'), 'strain: position')


@pytest.mark.parametrize('time', [0.0, 0.01, 1.0 / 3.0, 12345.678901234, 86400.0])
def test_stamps_keep_nanoseconds(time: float) -> None:
    from msg_config.messages import joint_state, nanoseconds, seconds, stamp_of

    stamp = nanoseconds(time)
    assert stamp_of(joint_state(stamp, ['a'], [0.0])) == stamp
    assert abs(seconds(stamp) - time) <= 5.1e-10


def judged(*stamps: int) -> list[Order]:
    """Return what a fresh order says of stamps, every 10 ns."""
    order = StampOrder(10)
    return [order.judge(stamp) for stamp in stamps]


def test_stamps_go_on_repeat_or_come_too_late() -> None:
    new, repeated, stale = Order.NEW, Order.REPEATED, Order.STALE
    assert judged(10, 20, 20, 15, 30) == [new, new, repeated, stale, new]
    assert judged(10, 20, 15, 30, 25, 40) == [new, new, stale, new, stale, new], (
        'stale samples that do not follow each other start nothing afresh')


def test_a_time_that_begins_again_is_told_from_one_late_sample() -> None:
    new, stale, restarted = Order.NEW, Order.STALE, Order.RESTARTED
    assert judged(100, 110, 0, 10, 20) == [new, new, stale, restarted, new]
    assert judged(100, 0, 0, 10) == [new, stale, restarted, new], 'the first sample, sent again'
    assert judged(0, 10, 0, 0, 10) == [new, new, stale, restarted, new], 'soon after the start'


def test_one_stamp_from_the_future_changes_nothing() -> None:
    new, stale, ahead = Order.NEW, Order.STALE, Order.AHEAD
    assert judged(10, 20, 90, 30, 40) == [new, new, ahead, new, new]
    assert judged(10, 20, 50, 30, 40, 60) == [new, new, new, stale, stale, new], (
        'too near to be doubted, and passed before long')
    assert judged(10, 20, 200, 210) == [new, new, ahead, new], 'a pause, and no new beginning'
