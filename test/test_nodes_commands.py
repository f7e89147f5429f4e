"""Which command acted, where drivers tell no effort or fill it in: live as from a bag."""

from __future__ import annotations

from functools import partial
from typing import Any, TYPE_CHECKING

from msg_config.acting_command import ActingCommand, APPLIED, NONE_TOLD, ZERO_TOLD
from msg_config.errors import InputError
from node_bench import Bench, GAUGES, JOINTS, STEP
import numpy as np
import pytest

if TYPE_CHECKING:
    from ros_loop import RosLoop

SAMPLES = 300
ONE, OTHER = np.array([0.6, -0.8]), np.array([0.1, 0.2])
ZERO, NONE = np.zeros(2), np.full(2, np.nan)


def test_the_command_sent_acts_where_efforts_are_zero_so_far() -> None:
    acting = ActingCommand()
    assert acting.until(0, ZERO) is ZERO
    # It answers the sample of its own stamp, so that it did not act up to that.
    acting.send(0, ONE)
    assert acting.until(STEP, ZERO) is ONE and acting.source == ZERO_TOLD
    acting.send(STEP, OTHER)
    assert acting.until(STEP, ZERO) is ONE
    assert acting.until(2 * STEP, NONE) is OTHER and acting.source == NONE_TOLD
    assert acting.until(2 * STEP, ONE) is ONE and acting.source == APPLIED
    # A driver that has told a command tells that it is zero, too.
    assert acting.until(3 * STEP, ZERO) is ZERO and acting.source == APPLIED
    acting.forget()
    assert acting.until(4 * STEP, ZERO) is ZERO
    with pytest.raises(InputError, match='expected 2 numbers, got none, and no command came'):
        acting.until(5 * STEP, NONE)


def swung() -> list[tuple[Any, Any]]:
    """Return samples of an arm of 0.1 kg that swings, and the commands after each."""
    from flex_plant_sim.simulation.plant_setup import simulator_of
    from msg_config.parameters import check_parameters

    simulator = simulator_of(check_parameters(
        'plant_sim', {'modes': 2, 'payload': 0.1, 'seed': 2}))
    found = []
    for k in range(SAMPLES):
        command = ONE * (1.0 if (k // 40) % 2 else -1.0) if k >= 10 else ZERO
        found.append((simulator.measure(), command))
        simulator.step(command)
    return found


@pytest.mark.ros
def test_a_driver_that_fills_efforts_with_zeros_is_weighed_by_the_topic_command(
        loop: RosLoop) -> None:
    from msg_config.messages import joint_state

    bench = Bench(loop, 'estimator', estimator='rpe', model='assumed_modes')
    payload, command = loop.record('payload_stamped'), loop.publisher('command')
    loop.until(lambda: bench.node.count_subscribers('payload_stamped') > 0
               and command.get_subscription_count() > 0)
    for k, (row, sent) in enumerate(swung()):
        bench.joint_states.publish(joint_state(k * STEP, JOINTS, row.angle, effort=ZERO))
        bench.strain.publish(joint_state(k * STEP, GAUGES, row.strain))
        loop.until(partial(bench.answers.stamps.__contains__, k * STEP))
        command.publish(joint_state(k * STEP, JOINTS, effort=sent))
        loop.until(lambda sent=sent: bench.node.acting.sent is not None  # type: ignore[misc]
                   and (bench.node.acting.sent == sent).all())
    assert payload[-1].position[0] == pytest.approx(0.1, abs=0.003)
    loop.until(lambda: any(value.value == ZERO_TOLD for value in bench.status('samples').values))


@pytest.mark.ros
def test_an_implausible_command_is_refused_where_it_arrives(loop: RosLoop) -> None:
    from msg_config.messages import joint_state

    bench, command = Bench(loop, 'estimator'), loop.publisher('command')
    loop.until(lambda: command.get_subscription_count() > 0)
    for number, (effort, text) in enumerate([
            ((0.5, -0.5), ''), ((0.0, 1e6), 'command of joint_2: expected at most'),
            ((np.nan, 0.0), 'command of joint_1: expected a finite number, got nan')]):
        command.publish(joint_state(number, JOINTS, effort=effort))
        if text:
            loop.until(lambda n=number: bench.node.rejected['command'] == n)  # type: ignore[misc]
            assert bench.node.last_rejection.startswith(f'command: effort: {text}')
        else:
            loop.until(lambda: bench.node.acting.sent is not None)
    bench.answered(1, effort=())
    assert bench.node.acting.sent.tolist() == [0.5, -0.5]
    assert not bench.node.rejected['joint_states']
