"""Errors of arithmetic inside a node: it says so, begins anew or stands still, and goes on."""

from __future__ import annotations

from typing import Any, TYPE_CHECKING

from node_bench import Bench, JOINTS, PAPER, STEP
import numpy as np
import pytest

if TYPE_CHECKING:
    from ros_loop import RosLoop

pytestmark = pytest.mark.ros


def _raise(*_: Any) -> Any:
    raise FloatingPointError('overflow')


def test_a_controller_whose_numbers_are_lost_begins_anew(loop: RosLoop) -> None:
    bench = Bench(loop, 'controller', watchdog=0.0)
    bench.answered(0)
    before = bench.answers[-1].effort.tolist()
    assert np.any(before)
    bench.node.controller.cost[:] = np.nan
    bench.answered(1)
    assert bench.answers[-1].effort.tolist() == before
    assert bench.node.rejected == {'command': 1}
    assert 'the command at 0.01 s is not finite' in bench.node.last_rejection
    bench.answered(2)
    assert np.isfinite(bench.answers[-1].effort).all() and np.any(bench.answers[-1].effort)
    assert bench.node.rejected == {'command': 1}


def test_a_controller_that_loses_its_numbers_at_every_sample_sends_zero(loop: RosLoop) -> None:
    bench = Bench(loop, 'controller', watchdog=0.0)
    bench.answered(0)
    command, bench.node.controller.command = bench.node.controller.command, _raise
    bench.answered(1)
    assert np.any(bench.answers[-1].effort)
    for k, fails in enumerate((_raise, lambda *_: np.array([np.nan, 1.0])), 2):
        bench.node.controller.command = fails
        bench.answered(k)
        assert not np.any(bench.answers[-1].effort)
    loop.until(lambda: bench.status('command') is not None and bench.status('command').message
               == '3 samples gave no finite command: the command is zero')
    bench.node.controller.command = command
    bench.answered(4)
    assert np.any(bench.answers[-1].effort)


@pytest.mark.parametrize('mode', ['lockstep', 'realtime'])
def test_an_arm_whose_numbers_are_lost_stands_still_until_a_reset(
        loop: RosLoop, mode: str) -> None:
    from flex_plant_sim.nodes.plant_sim_node import PlantSim
    from msg_config.messages import joint_state

    joints, diagnostics = loop.record('joint_states'), loop.record('/diagnostics')
    node = loop.start(PlantSim, **PAPER, mode=mode)
    command = loop.publisher('command')
    loop.until(lambda: len(joints) > 0)
    step, node.simulator.step = node.simulator.step, _raise
    command.publish(joint_state(max(joints.stamps), JOINTS, effort=(0.1, 0.1)))
    loop.until(lambda: any('the arm diverged at' in status.message for message in diagnostics
                           for status in message.status))
    count, node.simulator.step = len(joints), step
    loop.wait(0.3)
    assert len(joints) == count and np.isfinite([m.position for m in joints]).all()
    assert loop.call('plant_sim', 'reset').success
    loop.until(lambda: len(joints) > count)
    if mode == 'lockstep':
        command.publish(joint_state(0, JOINTS, effort=(0.1, 0.1)))
        loop.until(lambda: STEP in joints.stamps)
    else:
        loop.until(lambda: len(joints) > count + 5)


def test_a_timer_that_meets_an_error_of_arithmetic_ends_no_node(loop: RosLoop) -> None:
    bench = Bench(loop, 'controller')
    calls: list[int] = []

    def fail() -> None:
        calls.append(0)
        _raise()
    bench.node.every(0.01, fail)
    loop.until(lambda: len(calls) > 3)
    assert bench.node.rejected['timer'] >= 3
    assert bench.node.last_rejection == 'timer: overflow'
    bench.answered(0)
