"""Set-points that a JointTrajectory gives."""

from __future__ import annotations

from functools import partial
import re
from typing import Any, TYPE_CHECKING

from msg_config.errors import InputError
from msg_config.input_mapping import InputMapping
from node_bench import Bench, JOINTS
import numpy as np
import pytest

if TYPE_CHECKING:
    from ros_loop import RosLoop

pytestmark = pytest.mark.ros


def trajectory(names: Any, *points: tuple[Any, ...], stamp: int = 0) -> Any:
    """Return a JointTrajectory of (time, positions, velocities, accelerations)."""
    from builtin_interfaces.msg import Duration
    from msg_config.messages import time_message
    from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

    message = JointTrajectory(joint_names=list(names))
    message.header.stamp = time_message(stamp)
    for time, *values in points:
        whole, rest = divmod(round(time * 1e9), 10**9)
        message.points.append(JointTrajectoryPoint(
            **dict(zip(('positions', 'velocities', 'accelerations'), values)),
            time_from_start=Duration(sec=whole, nanosec=rest)))
    return message


def of(message: Any, before: Any, now: float, shape: str = 'spline') -> Any:
    """Return the set-points of a message for joints in the contract's names."""
    from flex_payload_estimator.control.trajectory import ReferenceTrajectory

    return ReferenceTrajectory.of(message, InputMapping().joint_channels(), np.array(before), now,
                                  shape)


def test_points_hold_from_their_times_on_where_steps_are_asked_for() -> None:
    points = of(trajectory(JOINTS[::-1], (1.0, [0.2, 0.1]), (2.0, [0.4, 0.3])),
                [9.0, 8.0], 5.0, 'steps')
    for time, wanted in ((5.9, [9.0, 8.0]), (6.0, [0.1, 0.2]), (6.9, [0.1, 0.2]),
                         (7.0, [0.3, 0.4]), (99.0, [0.3, 0.4])):
        assert points(time).tolist() == wanted
    stamped = of(trajectory(JOINTS, (0.0, [1.0, 2.0]), stamp=6 * 10**9), [0.0, 0.0], 5.0)
    assert stamped(5.99).tolist() == [0.0, 0.0]
    assert stamped(6.0).tolist() == [1.0, 2.0]


@pytest.mark.parametrize('degree', [1, 3, 5])
def test_a_spline_follows_the_polynomial_whose_derivatives_its_points_tell(degree: int) -> None:
    curves = np.polynomial.Polynomial([0.2, -0.3, 0.5, 0.7, -0.4, 0.1][:degree + 1]), \
        np.polynomial.Polynomial([-1.0, 0.4, 0.2, -0.6, 0.3, 0.2][:degree + 1])
    derivatives = (degree + 1) // 2
    rows = [(time, *([curve.deriv(k)(time) if k else curve(time) for curve in curves]
                     for k in range(derivatives))) for time in (0.0, 0.8, 2.0)]
    points = of(trajectory(JOINTS, *rows), [0.0, 0.0], 10.0)
    for time in np.linspace(0.0, 2.0, 41):
        np.testing.assert_allclose(points(10.0 + time), [curve(time) for curve in curves],
                                   atol=1e-9)
    assert points(99.0).tolist() == pytest.approx([curve(2.0) for curve in curves])


@pytest.mark.parametrize(('shape', 'derivatives'), [('steps', 1), *(
    ('spline', number) for number in (1, 2, 3))])
def test_all_looks_at_a_reference_are_what_it_says_at_their_times(
    shape: str, derivatives: int,
) -> None:
    rng = np.random.default_rng(derivatives)
    rows = [(time, *(list(rng.uniform(-1.0, 1.0, 2)) for _ in range(derivatives)))
            for time in (0.5, 0.8, 2.0)]
    points = of(trajectory(JOINTS, *rows), [0.3, -0.1], 10.0, shape)
    times, found = points.sampled(7)
    assert len(times) == (3 if shape == 'steps' else 22)
    np.testing.assert_allclose(found, [points(time) for time in times], atol=1e-9)


@pytest.mark.parametrize(('rows', 'got'), [
    ([(0.5, [0.1, 0.1]), (1.5, [1.7, 0.195]), (2.0, [9.0, 0.0])],
     '[1.7, 0.195] in points[1], which passes a limit 1.4 s after the first'),
    ([(0.0, [5.0, 0.0])], '[5, 0] in points[0], which passes a limit 0 s after the first'),
    ([(0.0, [1.0, 0.0], [0.0, 0.0]), (1.0, [1.4, 0.0], [-3.0, 0.0])],
     '[1.50422, 0] on the way, 0.45 s after the first'),
])
def test_a_set_point_beyond_a_limit_is_quoted_as_it_was_sent(rows: Any, got: str) -> None:
    points = of(trajectory(JOINTS, *rows), [0.0, 0.0], 10.0)
    with pytest.raises(InputError) as refused:
        points.check_within(np.array([-1.5, -2.0]), np.array([1.5, 2.0]), len(rows))
    assert str(refused.value) == (
        f'reference: points: expected [-1.5, -2] to [1.5, 2] rad, got {got}')
    points.check_within(np.full(2, -10.0), np.full(2, 10.0), len(rows))


def test_a_spline_begins_where_the_set_points_are() -> None:
    points = of(trajectory(JOINTS, (2.0, [0.4, 0.0])), [0.2, 0.1], 5.0)
    assert points(5.0).tolist() == [0.2, 0.1]
    assert points(6.0) == pytest.approx([0.3, 0.05])
    assert points(7.0).tolist() == [0.4, 0.0]


def test_a_trajectory_that_began_is_followed_from_now_on() -> None:
    began, rows = 4 * 10**9, [(0.5, [0.1, 0.1]), (2.0, [0.4, -0.2]), (3.0, [0.5, 0.0])]
    passed = of(trajectory(JOINTS, *rows, stamp=began), [9.0, 9.0], 5.25)
    assert passed(5.25) == pytest.approx([0.25, -0.05])
    assert passed(7.0).tolist() == [0.5, 0.0]
    # With its first point ahead there is no piece of it yet to be on.
    ahead = of(trajectory(JOINTS, *rows, stamp=began), [-0.1, -0.1], 4.25)
    assert ahead(4.25).tolist() == [-0.1, -0.1]
    assert ahead(4.375) == pytest.approx([0.0, 0.0])
    assert ahead(4.5).tolist() == [0.1, 0.1]


def test_a_set_point_is_stamped_before_the_sample_that_it_meets() -> None:
    asked = trajectory(JOINTS, (0.0, [0.1, 0.2]), stamp=4_980_000_000)
    assert of(asked, [0.0, 0.0], 5.0)(5.0).tolist() == [0.1, 0.2]
    with pytest.raises(InputError, match=r'header.stamp: .* last point 4.98 s'):
        of(asked, [0.0, 0.0], 6.0)
    with pytest.raises(InputError, match=r'header.stamp: .* last point 4.99 s'):
        of(trajectory(JOINTS, (0.0, [0.0, 0.0]), (0.01, [0.1, 0.2]), stamp=4_980_000_000),
           [0.0, 0.0], 5.0)


ROWS = ((2.0, [0.4, 0.4]), (4.0, [0.9, -0.9]))


@pytest.mark.parametrize(('stamp', 'got'), [
    (5.0, '5 s, last point 9 s'), (990.0, '990 s, last point 994 s'),
    (1001.5, '1001.5 s, last point 1005.5 s'), (1.7e9, '1700000000 s, last point 1700000004 s')])
@pytest.mark.parametrize('early', [False, True])
def test_a_reference_by_another_clock_is_refused_and_the_old_one_kept(
    loop: RosLoop, stamp: float, got: str, early: bool,
) -> None:
    bench, reference = Bench(loop, 'controller'), loop.publisher('reference')
    before = bench.node.reference.set_points
    if not early:
        bench.answered(100_000)
        reference.publish(trajectory(JOINTS, (0.0, [0.2, 0.2])))
        loop.until(lambda: bench.node.reference.given)
        before = bench.node.reference.set_points
    reference.publish(trajectory(JOINTS, *ROWS, stamp=round(stamp * 1e9)))
    if early:
        loop.until(lambda: bench.node.reference.given)
        bench.answered(100_000)
    rest = iter(range(100_001, 100_100))

    def refused() -> bool:
        # On a busy machine the measurements may have paused for long enough to wait for the next.
        if not early and bench.node.silence():
            bench.sample(next(rest))
        return bool(bench.node.rejected['reference'])

    loop.until(refused)
    assert re.fullmatch(
        r'reference: header.stamp: expected 0 \(start now\), or a start at most 1 s ahead with a '
        rf'point that is not past, by the clock of the measurements, 1000(\.\d+)? s; got {got}',
        bench.node.last_rejection)
    assert bench.node.reference.set_points is before
    assert bench.node.reference.given is not early
    loop.until(lambda: bench.status('input') is not None
               and 'reference: header.stamp' in bench.status('input').message)


@pytest.mark.parametrize('early', [False, True])
def test_a_reference_by_the_clock_of_the_measurements_is_obeyed(
        loop: RosLoop, early: bool) -> None:
    bench, reference = Bench(loop, 'controller'), loop.publisher('reference')
    if not early:
        bench.answered(100_000)
    reference.publish(trajectory(JOINTS, *ROWS, stamp=1000 * 10**9 + 500_000_000))
    loop.until(lambda: bench.node.reference.given)
    if early:
        bench.answered(100_000)
    np.testing.assert_allclose(bench.node.reference.set_points(1002.5), 0.4, atol=1e-9)
    np.testing.assert_allclose(bench.node.reference.set_points(1004.5), [0.9, -0.9], atol=1e-9)


def test_a_reference_in_a_pause_of_the_measurements_begins_with_the_next_one(
        loop: RosLoop) -> None:
    bench, reference = Bench(loop, 'controller'), loop.publisher('reference')
    bench.answered(100)
    reference.publish(trajectory(JOINTS, (0.0, [0.1, 0.1])))
    loop.until(partial(_asks, bench, 0.1))
    bench.answered(101)
    loop.until(lambda: bool(bench.node.silence()))
    reference.publish(trajectory(JOINTS, (1.0, [0.3, 0.3])))
    loop.until(partial(_asks, bench, 0.3))
    # A stamp that has leapt is believed with the next one.
    bench.sample(6000)
    bench.answered(6001)
    for time, wanted in ((60.01, 0.1), (60.51, 0.2), (61.01, 0.3), (99.0, 0.3)):
        np.testing.assert_allclose(bench.node.reference.set_points(time), wanted, atol=1e-9)


@pytest.mark.parametrize(('message', 'text'), [
    ((JOINTS,), 'points: expected at least one, got none'),
    ((('a', 'b'), (0.0, [0.0, 0.0])), 'joint_names: name: expected joint_1, joint_2;'),
    ((JOINTS, (0.0, [300.0, 0.0])), 'reference: points: expected '),
    ((JOINTS, (0.0, [0.0, 0.0], [1e308, 0.0]), (1.0, [0.0, 0.0], [0.0, 0.0])),
     's after the first'),
    ((JOINTS, (0.0, [0.0])), 'points.positions: expected 2 values, got 1'),
    ((JOINTS, (0.0, [0.0, np.nan])), 'points.positions of joint_2: expected a finite number'),
    ((JOINTS, (1.0, [0.0, 0.0]), (1.0, [0.0, 0.0])), 'expected increasing times'),
    ((JOINTS, (-5.0, [0.0, 0.0]), (1.0, [0.0, 0.0])), 'expected increasing times >= 0 s, '
     'got [-5.0, 1.0]'),
])
def test_a_bad_reference_is_rejected_and_the_old_one_kept(
    loop: RosLoop, message: Any, text: str,
) -> None:
    bench = Bench(loop, 'controller')
    reference = loop.publisher('reference')
    before = bench.node.reference.set_points
    reference.publish(trajectory(message[0], *message[1:]))
    loop.until(lambda: bench.node.rejected['reference'] == 1)
    assert text in bench.node.last_rejection
    assert bench.node.reference.set_points is before
    reference.publish(trajectory(JOINTS, (0.0, [0.0, 0.0])))
    loop.until(lambda: bench.node.reference.set_points is not before)


def test_a_reference_before_the_first_sample_begins_with_it(loop: RosLoop) -> None:
    bench = Bench(loop, 'controller')
    before = bench.node.reference.set_points(1000.0)
    loop.publisher('reference').publish(trajectory(JOINTS, (5.0, [0.4, 0.4]), (10.0, [0.9, -0.9])))
    loop.until(lambda: bench.node.reference.given)
    bench.answered(100_000)
    np.testing.assert_allclose(bench.node.reference.set_points(1000.0), before, atol=1e-9)
    np.testing.assert_allclose(bench.node.reference.set_points(1005.0), 0.4, atol=1e-9)
    np.testing.assert_allclose(bench.node.reference.set_points(1010.0), [0.9, -0.9], atol=1e-9)


@pytest.mark.parametrize('next_one', [
    [((1.0, [300.0, 0.0]),), ((5.0, [0.4, 0.4]), (10.0, [0.9, -0.9]))],
    [((5.0, [0.4, 0.4]), (10.0, [0.9, -0.9])), ((1.0, [300.0, 0.0]),)],
    [((1.0, [0.2, 0.2]),), ((5.0, [0.4, 0.4]), (10.0, [0.9, -0.9]))]])
def test_of_references_before_the_first_sample_the_last_good_one_begins_with_it(
        loop: RosLoop, next_one: Any) -> None:
    bench, reference = Bench(loop, 'controller'), loop.publisher('reference')
    before = bench.node.reference.set_points(1000.0)
    bad = [any(300.0 in row[1] for row in rows) for rows in next_one]
    for number, rows in enumerate(next_one):
        reference.publish(trajectory(JOINTS, *rows))
        loop.until(lambda n=number, bad=bad: (  # type: ignore[misc]
            bench.node.rejected['reference'] == sum(bad[:n + 1])
            and (bad[n] or np.allclose(bench.node.reference.set_points(60.0),
                                       next_one[n][-1][1]))))
    bench.answered(100_000)
    np.testing.assert_allclose(bench.node.reference.set_points(1000.0), before, atol=1e-9)
    np.testing.assert_allclose(bench.node.reference.set_points(1005.0), 0.4, atol=1e-9)
    np.testing.assert_allclose(bench.node.reference.set_points(1010.0), [0.9, -0.9], atol=1e-9)


def _asks(bench: Bench, target: float) -> bool:
    return bool(np.allclose(bench.node.reference.set_points(9.0), target))


def test_a_leap_in_time_drives_no_trajectory_once_more(loop: RosLoop) -> None:
    bench = Bench(loop, 'controller')
    reference = loop.publisher('reference')
    bench.answered(100)
    for k, target in ((101, 0.3), (102, 0.1)):
        reference.publish(trajectory(JOINTS, (0.0, [target, target])))
        loop.until(partial(_asks, bench, target))
        bench.answered(k)
    for k in range(10):
        bench.sample(k)
    loop.until(lambda: bench.node.order.last == bench.node.order.interval * 9)
    for time in (0.01, 0.5, 1.2, 60.0):
        np.testing.assert_allclose(bench.node.reference.set_points(time), 0.1)
