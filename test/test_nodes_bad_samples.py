"""One bad sample of each kind in the running loop: nothing is fooled, and nothing stays wrong."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TYPE_CHECKING

from faults.bad_samples import BAD_SAMPLES
from msg_config.parameters import check_parameters
import numpy as np
import pytest

if TYPE_CHECKING:
    from rclpy.context import Context
    from ros_loop import RosLoop

pytestmark = pytest.mark.ros
STEP = 10_000_000
# The payload is known by the first, and a second passes between two.
FIRST, BETWEEN = 300, 100
VALUES: dict[str, Any] = {'modes': 2}
SEED = {'seed': 5}


def spoiled_loop(loop: RosLoop, kinds: list[str]) -> tuple[dict[int, Any], dict[int, Any], Any]:
    """Run the loop with one bad sample of each kind; return joints and payloads by stamp."""
    from faults.relay import at_stamps, Relay, remapped
    from flex_payload_estimator.nodes.lqg_controller_node import LQGControllerNode
    from flex_payload_estimator.nodes.payload_estimator_node import PayloadEstimatorNode
    from flex_plant_sim.nodes.plant_sim_node import PlantSim
    from ros_loop import overrides

    spoilers: dict[str, dict[int, Any]] = {'joint_states': {}, 'strain': {}}
    for number, kind in enumerate(kinds):
        topic, spoil = BAD_SAMPLES[kind]
        spoilers[topic][(FIRST + BETWEEN * number) * STEP] = spoil
    done: set[int] = set()
    loop.add(Relay, {topic: at_stamps(own, done) for topic, own in spoilers.items()})
    joints = loop.record('joint_states', 'raw/joint_states')
    payload = loop.record('payload_stamped')
    controller = loop.start(LQGControllerNode, **VALUES, watchdog=0.0)
    loop.start(PayloadEstimatorNode, **VALUES)
    loop.add(PlantSim, cli_args=remapped('joint_states', 'strain'),
             parameter_overrides=overrides({**VALUES, **SEED}))
    end = (FIRST + BETWEEN * len(kinds)) * STEP
    loop.until(lambda: end in payload.stamps, timeout=300.0)
    assert len(done) == len(kinds)
    return joints.by_stamp(), payload.by_stamp(), controller


def undisturbed(samples: int) -> Any:
    """Return the same loop offline, without a bad sample."""
    from flex_payload_estimator.control.loop import run_loop
    from flex_payload_estimator.nodes.node_setup import controller_of, estimator_of, set_points_of
    from flex_plant_sim.simulation.plant_setup import simulator_of

    controller = check_parameters('lqg_controller', VALUES)
    return run_loop(simulator_of(check_parameters('plant_sim', {**VALUES, **SEED})),
                    estimator_of(check_parameters('payload_estimator', VALUES)),
                    controller_of(controller), set_points_of(controller), 0.01 * samples)


def check(kinds: list[str], joints: dict[int, Any], payload: dict[int, Any], end: int) -> None:
    """Compare with the undisturbed run: joints always, the payload a second after each."""
    record = undisturbed(end)
    for k in range(end):
        off = np.abs(np.array(joints[k * STEP].position) - record.output[k, :2]).max()
        kind = kinds[max(k - FIRST, 0) // BETWEEN]
        assert off < 0.1, f'{kind}: a joint is {off:.3g} rad off at sample {k}'
    for number, kind in enumerate(kinds):
        k = FIRST + BETWEEN * (number + 1)
        message = payload[k * STEP]
        allowed = np.sqrt(message.effort[0]) + 0.01 * record.mass[k]
        assert abs(message.position[0] - record.mass[k]) < allowed, kind


FEW = ['angle 1e9', 'angle 20', 'angle nan', 'effort 1e308', 'nanosec 2e9', 'a year ahead',
       'strain 1', 'strain 1e300', 'no names', 'three strains']


def test_a_bad_sample_of_each_kind_changes_nothing_for_long(ros_context: Context) -> None:
    from ros_loop import RosLoop

    loop = RosLoop(ros_context)
    joints, payload, controller = spoiled_loop(loop, FEW)
    loop.close()
    check(FEW, joints, payload, FIRST + BETWEEN * len(FEW))
    assert controller.rejected.total() >= len(FEW) - 1


def _frozen(message: Any) -> None:
    message.position[0] = 0.3


def _inverted(message: Any) -> None:
    message.position[1] *= -1.0


def _exchanged(message: Any) -> None:
    message.position = message.position[::-1]


def _a_turn_on(message: Any) -> None:
    message.position[0] += 2.0 * np.pi


def _without_velocity(spoil: Callable[[Any], None]) -> Callable[[Any], None]:
    def both(message: Any) -> None:
        message.velocity = []
        spoil(message)
    return both


def _stuck() -> Callable[[Any], None]:
    kept: list[float] = []

    def spoil(message: Any) -> None:
        kept.append(message.position[0])
        message.position[0] = kept[0]
    return spoil


def _dead(message: Any) -> None:
    message.position[1] = 0.0


def _drifting(message: Any) -> None:
    message.position[1] += 0.2 * (_time(message) - 1e-9 * FIRST * STEP)


def _slipped(message: Any) -> None:
    message.position[0] += 0.3


def _time(message: Any) -> float:
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


COMMANDED, LEAPT = 'does not move as its command asks', 'is '


@pytest.mark.parametrize('topic, spoil, said, reach', [
    ('joint_states', _frozen, 'joint_1: its angle went', 1.0),
    ('joint_states', _without_velocity(_frozen), f'joint_1 {LEAPT}', 1.0),
    ('joint_states', _without_velocity(_stuck()), f'joint_1 {COMMANDED}', 7.0),
    ('joint_states', _inverted, 'joint_2: its angle went', 1.0),
    ('joint_states', _without_velocity(_inverted), f'joint_2 {LEAPT}', 2.0),
    ('joint_states', _exchanged, 'its angle went', 1.0),
    ('joint_states', _without_velocity(_exchanged), 'The command is zero until ~/reset', 7.0),
    ('joint_states', _drifting, 'joint_2: its angle went', 1.0),
    ('joint_states', _without_velocity(_slipped), f'joint_1 {LEAPT}', 1.0),
    ('joint_states', _a_turn_on, 'samples said nothing: the command is zero', 1.0),
    ('strain', _dead, 'the gauges do not move as the arm bends', 1.0)])
def test_a_sensor_that_lies_for_good_does_not_drive_the_arm_away(
        ros_context: Context, topic: str, spoil: Callable[[Any], None], said: str, reach: float,
) -> None:
    from faults.relay import Relay, remapped
    from flex_payload_estimator.nodes.lqg_controller_node import LQGControllerNode
    from flex_plant_sim.nodes.plant_sim_node import PlantSim
    from msg_config.messages import stamp_of
    from ros_loop import overrides, RosLoop

    def alter(message: Any, send: Callable[[Any], None]) -> None:
        if stamp_of(message) >= FIRST * STEP:
            spoil(message)
        send(message)
    loop = RosLoop(ros_context)
    loop.add(Relay, {topic: alter})
    joints = loop.record('joint_states',
                         'raw/joint_states' if topic == 'joint_states' else 'joint_states')
    commands, diagnostics = loop.record('command'), loop.record('/diagnostics')
    loop.start(LQGControllerNode, **VALUES, adapt=False, payload_initial=0.1)
    loop.add(PlantSim, cli_args=remapped(topic),
             parameter_overrides=overrides({**VALUES, **SEED}))
    loop.until(lambda: (FIRST + 1000) * STEP in joints.stamps, timeout=120.0)
    loop.until(lambda: any(said in status.message for message in diagnostics
                           for status in message.status))
    assert not any(commands[-1].effort)
    assert np.abs([message.position for message in joints]).max() < reach
    last = np.array([message.position for message in joints[-100:]])
    assert np.ptp(last, axis=0).max() < 0.01
    loop.close()
