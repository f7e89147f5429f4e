"""One bad sample of each kind in the running loop: nothing is fooled, and nothing stays wrong."""

from __future__ import annotations

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
