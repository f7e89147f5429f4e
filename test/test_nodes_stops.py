"""What stops the arm, and what alone lets it go on."""

from __future__ import annotations

from collections.abc import Callable
import signal
from typing import TYPE_CHECKING

from node_bench import Bench, STEP
import numpy as np
import pytest

if TYPE_CHECKING:
    from rclpy.context import Context
    from ros_loop import RosLoop

pytestmark = pytest.mark.ros


def stuck(bench: Bench, first: int, samples: int) -> None:
    """Feed an arm that does not move whatever it is commanded, as one whose encoder is stuck."""
    for k in range(first, first + samples):
        bench.answered(k, angle=(-1.0, -1.0), effort=bench.answers[-1].effort
                       if bench.answers else (0.0, 0.0))


def test_a_stop_for_a_sensor_outlasts_a_leap_in_time(loop: RosLoop) -> None:
    bench = Bench(loop, 'controller', reference_amplitude=0.5, reference_period=10.0)
    for k in range(100):
        stuck(bench, k, 1)
        if bench.node.watch.fault:
            break
    assert 'does not move as its command asks' in bench.node.watch.fault
    assert np.abs([m.effort for m in bench.answers]).max() > 2.0
    # The driver's clock is set 5 s ahead; the first stamp alone is not believed.
    bench.sample(k + 500, angle=(-1.0, -1.0))
    count = len(bench.answers)
    stuck(bench, k + 501, 20)
    assert not np.any([message.effort for message in bench.answers[count:]])
    loop.until(lambda: bench.status('command') is not None
               and 'The command is zero until ~/reset' in bench.status('command').message)
    assert loop.call('lqg_controller', 'reset').success
    stuck(bench, k + 521, 3)
    assert np.any(bench.answers[-1].effort)


@pytest.mark.parametrize(('number', 'code'), [
    (signal.SIGINT, 130),
    pytest.param(signal.SIGHUP, 129, marks=pytest.mark.skipif(
        signal.getsignal(signal.SIGHUP) is signal.SIG_IGN, reason='nohup ignores it'))])
def test_a_controller_that_is_asked_to_end_leaves_a_command_of_zero(
        ros_context: Context, domain_id: int, number: signal.Signals, code: int) -> None:
    from msg_config.messages import joint_state
    from node_bench import GAUGES, JOINTS
    from ros_loop import RosLoop
    from test_nodes_processes import start

    loop = RosLoop(ros_context)
    commands = loop.record('command')
    process = start(domain_id, 'lqg_controller', 'model:=paper_reduced', 'modes:=2',
                    'adapt:=false')
    try:
        joints, strain = loop.publisher('joint_states'), loop.publisher('strain')
        k = 0
        while len(commands.stamps) < 5:  # the first ones come before the processes know each other
            k += 1
            joints.publish(joint_state(k * STEP, JOINTS, (-0.5, -0.5), effort=(0.0, 0.0)))
            strain.publish(joint_state(k * STEP, GAUGES, (0.0,) * 4))
            loop.wait(0.01)
        assert np.abs(commands[-1].effort).max() > 0.1
        process.send_signal(number)
        _, error = process.communicate(timeout=20.0)
        assert process.returncode == code, error
        loop.until(lambda: not np.any(commands[-1].effort))
        loop.wait(0.1)
        assert not np.any(commands[-1].effort)
    finally:
        process.kill()
        process.communicate()
        loop.close()


def test_strain_at_a_third_of_the_rate_gets_no_command(loop: RosLoop) -> None:
    bench = Bench(loop, 'controller', watchdog=0.0)
    bench.seldom(range(70), 3)
    assert np.any([message.effort for message in bench.answers])
    assert not np.any(bench.answers[-1].effort)
    loop.until(lambda: bench.status('command') is not None
               and bench.status('command').message == (
        'samples come every 0.03 s (joint_states every 0.01 s, strain every 0.03 s), '
        'expected 0.01 s (sample_time): the command is zero'))
    bench.seldom(range(70, 95), 1)
    assert np.any(bench.answers[-1].effort)


SLEW = 20.0


def ramped(bench: Bench, wanted: float, first: int, samples: int) -> None:
    """Feed a controller that wants one command and keeps to a slew rate."""
    bench.node.controller.command = lambda *_: np.full(2, wanted)
    for k in range(first, first + samples):
        bench.answered(k)


@pytest.mark.parametrize('again', ['reset', 'leap'])
def test_neither_a_reset_nor_a_leap_in_time_breaks_the_slew_rate(
        loop: RosLoop, again: str) -> None:
    bench = Bench(loop, 'controller', command_slew=SLEW, watchdog=0.0)
    ramped(bench, 4.0, 0, 20)
    assert bench.answers[-1].effort.tolist() == pytest.approx([4.0, 4.0])
    if again == 'reset':
        assert loop.call('lqg_controller', 'reset').success
    else:
        bench.sample(520)
    ramped(bench, 4.0, 521, 1)
    ramped(bench, 0.0, 522, 3)
    sent = np.array([message.effort for message in bench.answers])
    assert np.abs(np.diff(sent, axis=0)).max() <= SLEW * STEP * 1e-9 + 1e-9
    assert sent[-4:, 0] == pytest.approx([4.0, 3.8, 3.6, 3.4])


def test_the_command_goes_to_zero_where_no_sample_follows_a_reset(loop: RosLoop) -> None:
    bench = Bench(loop, 'controller', watchdog=0.2)
    ramped(bench, 4.0, 0, 2)
    assert loop.call('lqg_controller', 'reset').success
    loop.until(lambda: not np.any(bench.answers[-1].effort))


def test_a_controller_that_becomes_inactive_sends_zero_at_once(loop: RosLoop) -> None:
    bench = Bench(loop, 'controller', command_slew=SLEW, watchdog=0.0)
    ramped(bench, 4.0, 0, 20)
    assert loop.call('lqg_controller', 'reset').success
    bench.node.trigger_deactivate()
    loop.until(lambda: not np.any(bench.answers[-1].effort))
    bench.node.trigger_activate()
    ramped(bench, 4.0, 30, 1)
    assert bench.answers[-1].effort.tolist() == pytest.approx([0.2, 0.2])


def silent(bench: Bench) -> None:
    """Give no sample until the watchdog has sent a command."""
    count = len(bench.answers)
    bench.loop.until(lambda: len(bench.answers) > count)


def blind(bench: Bench) -> None:
    """Give two samples in a row that the arm cannot have made."""
    for k in (20, 21):
        bench.answered(k, angle=(50.0, 50.0))


def contradicted(bench: Bench) -> None:
    """Give samples of an arm that does not move until the controller blames a sensor."""
    for k in range(20, 200):
        stuck(bench, k, 1)
        if bench.node.watch.fault:
            return


@pytest.mark.parametrize('cause', [silent, blind, contradicted])
def test_a_stop_does_not_keep_to_the_slew_rate(
        loop: RosLoop, cause: Callable[[Bench], None]) -> None:
    bench = Bench(loop, 'controller', command_slew=SLEW, watchdog=0.5)
    ramped(bench, 4.0, 0, 20)
    assert bench.answers[-1].effort.tolist() == pytest.approx([4.0, 4.0])
    cause(bench)
    assert not np.any(bench.answers[-1].effort)


def test_samples_at_another_rate_stop_the_arm_at_once(loop: RosLoop) -> None:
    bench = Bench(loop, 'controller', command_slew=SLEW, watchdog=0.0)
    bench.node.controller.command = lambda *_: np.full(2, 4.0)
    bench.seldom(range(70), 3)
    sent = np.array([message.effort[0] for message in bench.answers])
    assert sent.max() == pytest.approx(4.0)
    assert not sent[sent.argmax():][sent[sent.argmax():] < 4.0 - 1e-9].any()
