"""Samples that come more seldom than told, or no more: what the estimator says of the time."""

from __future__ import annotations

from typing import Any, TYPE_CHECKING

from node_bench import Bench, GAUGES, STEP
import pytest

if TYPE_CHECKING:
    from ros_loop import RosLoop

pytestmark = pytest.mark.ros


def estimate_text(bench: Bench) -> str:
    """Return what the diagnostics say of the estimate."""
    status: Any = bench.status('estimate')
    return '' if status is None else str(status.message)


def test_the_estimator_takes_the_mean_of_the_commands_between_two_samples(loop: RosLoop) -> None:
    bench = Bench(loop, 'estimator')
    taken, update = [], bench.node.estimator.update

    def noted(time: float, output: Any, command: Any) -> Any:
        taken.append(command.tolist())
        return update(time, output, command)
    bench.node.estimator.update = noted
    bench.seldom(range(70), 3)
    # The efforts are 0, 0.1, 0.2, 0, … from the first sample on.
    assert taken[1:] == [pytest.approx([0.1, 0.0])] * 23
    bench.diagnostics.clear()
    bench.node.report()
    loop.until(lambda: bool(estimate_text(bench)))
    assert 'are not known' not in estimate_text(bench)
    assert bench.status('samples').message == (
        'samples come every 0.03 s (joint_states every 0.01 s, strain every 0.03 s), '
        'expected 0.01 s (sample_time)')


def test_an_estimate_between_whose_samples_commands_are_unknown_is_not_ok(loop: RosLoop) -> None:
    from msg_config.messages import joint_state

    bench = Bench(loop, 'estimator')
    for k in range(0, 46):
        bench.strain.publish(joint_state(k * STEP, GAUGES, (0.0,) * 4))
        if k % 2 == 0:
            bench.joint_only(k, (0.0, 0.0), (0.0, 0.0))
    loop.until(lambda: estimate_text(bench) == (
        'the commands between samples are not known: samples come every 0.02 s '
        '(joint_states every 0.02 s, strain every 0.01 s), expected 0.01 s (sample_time)'))
    assert bench.status('estimate').level == b'\x01'


def test_an_estimate_without_samples_is_stale_with_its_age(loop: RosLoop) -> None:
    bench = Bench(loop, 'estimator')
    for k in range(3):
        bench.answered(k)
    loop.until(lambda: bench.status('estimate') is not None
               and bench.status('estimate').level == b'\x03', 3.0)
    text = bench.status('estimate').message
    assert text.startswith('no sample for 0.') and 'no message on /joint_states' in text
    assert bench.status('model').level == b'\x03'
    bench.answered(3)
    loop.until(lambda: bench.status('estimate').level == b'\x00', 3.0)
