"""The lifecycle: nothing is done before a node is active, and nothing after."""

from __future__ import annotations

import gc
from typing import Any, TYPE_CHECKING

from node_bench import Bench
import numpy as np
import pytest

if TYPE_CHECKING:
    from ros_loop import RosLoop

pytestmark = pytest.mark.ros


def change(loop: RosLoop, node: str, label: str) -> bool:
    """Ask for a transition of the lifecycle, as `ros2 lifecycle set` does."""
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState

    client: Any = loop.observer.create_client(ChangeState, f'{node}/change_state')
    loop.until(client.service_is_ready)
    future = client.call_async(ChangeState.Request(transition=Transition(label=label)))
    loop.until(future.done)
    return bool(future.result().success)


def test_the_controller_does_nothing_until_it_is_active(loop: RosLoop) -> None:
    bench = Bench(loop, 'controller', autostart=False)
    bench.sample(0)
    loop.wait(0.3)
    assert not bench.answers
    assert change(loop, 'lqg_controller', 'configure')
    bench.sample(1)
    loop.wait(0.3)
    assert not bench.answers
    assert change(loop, 'lqg_controller', 'activate')
    for k in range(2, 5):
        bench.answered(k, angle=(-0.5, -0.5))
    assert np.abs(bench.answers[-1].effort).max() > 0.1
    assert change(loop, 'lqg_controller', 'deactivate')
    loop.until(lambda: not np.any(bench.answers[-1].effort))
    count = len(bench.answers)
    bench.sample(5)
    loop.wait(0.3)
    assert len(bench.answers) == count
    assert not change(loop, 'lqg_controller', 'deactivate')
    assert change(loop, 'lqg_controller', 'activate')
    bench.answered(6)


def test_configure_begins_as_at_the_start_with_what_was_set(loop: RosLoop) -> None:
    from rclpy.parameter import Parameter

    bench = Bench(loop, 'estimator')
    bench.answered(0)
    for label in ('deactivate', 'cleanup'):
        assert change(loop, 'payload_estimator', label)
    assert bench.node.set_parameters_atomically([Parameter('modes', value=1)]).successful
    for label in ('configure', 'activate'):
        assert change(loop, 'payload_estimator', label)
    bench.diagnostics.clear()
    bench.node.report()
    loop.until(lambda: bench.status('estimate') is not None)
    assert bench.node.values['modes'] == 1
    assert bench.status('estimate').message == 'no sample yet'
    assert bench.status('parameters').message == 'ok'


@pytest.mark.parametrize('kind', ['controller', 'estimator'])
def test_a_destroyed_node_leaves_the_graph_without_the_garbage_collector(
        loop: RosLoop, kind: str) -> None:
    gc.disable()
    try:
        node = Bench(loop, kind).node
        name = node.get_name()
        loop.until(lambda: bool(loop.observer.count_services(f'{name}/change_state')))
        loop.stop(node)
        loop.until(lambda: name not in loop.observer.get_node_names()
                   and not loop.observer.count_services(f'{name}/change_state'), timeout=5.0)
    finally:
        gc.enable()


def test_the_plant_begins_when_it_becomes_active(loop: RosLoop) -> None:
    from flex_plant_sim.nodes.plant_sim_node import PlantSim

    joints = loop.record('joint_states')
    loop.start(PlantSim, autostart=False, modes=2)
    loop.wait(0.3)
    assert not joints
    assert change(loop, 'plant_sim', 'configure')
    assert change(loop, 'plant_sim', 'activate')
    loop.until(lambda: 0 in joints.stamps)


@pytest.mark.parametrize('mode', ['lockstep', 'realtime'])
def test_the_plant_s_services_move_nothing_before_and_after_it_is_active(
        loop: RosLoop, mode: str) -> None:
    from flex_plant_sim.nodes.plant_sim_node import PlantSim

    joints = loop.record('joint_states')
    node = loop.start(PlantSim, autostart=False, modes=2, mode=mode)

    def use_services() -> None:
        assert loop.call('plant_sim', 'pause', data=True).success
        step = loop.call('plant_sim', 'step')
        assert not step.success and step.message == 'expected an active node: activate it first'
        assert loop.call('plant_sim', 'pause', data=False).success
        assert loop.call('plant_sim', 'reset').success

    use_services()
    assert not joints
    assert change(loop, 'plant_sim', 'configure') and change(loop, 'plant_sim', 'activate')
    loop.until(lambda: bool(joints))
    assert change(loop, 'plant_sim', 'deactivate')
    loop.wait(0.1)
    count = len(joints)
    use_services()
    loop.wait(0.1)
    assert len(joints) == count and node.simulator.samples == 0
