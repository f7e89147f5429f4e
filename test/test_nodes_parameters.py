"""Parameters of running nodes, set as `ros2 param set` does: applied, or refused with a reason."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TYPE_CHECKING

from msg_config.parameters import load_parameters, parameter_file
from node_bench import another, Bench, PAPER
import numpy as np
import pytest

if TYPE_CHECKING:
    from rclpy.context import Context
    from ros_loop import RosLoop

pytestmark = pytest.mark.ros
NODES = ('plant_sim', 'payload_estimator', 'lqg_controller')
# Another good value where the one made from the row's limits would not do.
OTHER: dict[str, Any] = {
    'regression': 'resolvent', 'modes': 1, 'model': 'assumed_modes', 'estimator': 'rpe',
    'process_noise': 0.0, 'n_prime': 12}


def start(loop: RosLoop, name: str) -> Any:
    """Start one node."""
    from flex_payload_estimator.nodes.lqg_controller_node import LQGControllerNode
    from flex_payload_estimator.nodes.payload_estimator_node import PayloadEstimatorNode
    from flex_plant_sim.nodes.plant_sim_node import PlantSim

    kinds = {'plant_sim': PlantSim, 'payload_estimator': PayloadEstimatorNode,
             'lqg_controller': LQGControllerNode}
    return loop.start(kinds[name], **PAPER, **(
        {'estimator': 'sf1'} if name == 'payload_estimator' else {}))


def setting(loop: RosLoop, node: str, **values: Any) -> Any:
    """Return the answer to a request that sets parameters, from a client of another node."""
    from rclpy.parameter import Parameter
    from rclpy.parameter_client import AsyncParameterClient

    client = AsyncParameterClient(loop.observer, node)
    loop.until(client.services_are_ready)
    future: Any = client.set_parameters([Parameter(k, value=v) for k, v in values.items()])
    loop.until(future.done)
    return future.result().results


@pytest.mark.parametrize('name', NODES)
def test_every_parameter_is_applied_or_refused_with_a_reason(loop: RosLoop, name: str) -> None:
    node = start(loop, name)
    for row in load_parameters()[name].values():
        before = node.values[row.name]
        wanted = OTHER.get(row.name, another(row, before))
        result, = setting(loop, name, **{row.name: wanted})
        if row.applies == 'read_only':
            assert not result.successful
            assert f'{row.name}: read-only' in result.reason
            assert node.get_parameter(row.name).value == before
            continue
        assert result.successful, result.reason
        if row.applies == 'live':
            assert node.values[row.name] == row.check(wanted)
            continue
        if before != row.check(wanted):
            said = node.parameter_status().message.partition('; ')[0]
            assert said == f'{row.name}: in force after ~/reset'
        assert node.values[row.name] == before
        assert loop.call(name, 'reset').success
        assert node.values[row.name] == row.check(wanted), row.name
    for unknown in ('paylod', 'mass'):
        result, = setting(loop, name, **{unknown: 0.1})
        assert not result.successful
        assert result.reason


@pytest.mark.parametrize(('name', 'value', 'text'), [
    ('payload', -1.5, 'payload'), ('payload', -0.5, '0 to 1000 kg, or -1, got -0.5'),
    ('payload', 'heavy', 'payload: expected a number'),
    ('modes', 0, 'modes'), ('modes', 2.5, 'modes'), ('effects', [1.0], 'expected a list of texts'),
    ('effects', ['magic:joint_1:level=1'], "got 'magic'"),
    ('payload_schedule', [1.0], 'expected pairs'), ('mode', 'realtime', 'read-only')])
def test_what_does_not_fit_is_refused_and_changes_nothing(
    loop: RosLoop, name: str, value: Any, text: str,
) -> None:
    node = start(loop, 'plant_sim')
    before = dict(node.values)
    result, = setting(loop, 'plant_sim', **{name: value})
    assert not result.successful
    assert text in result.reason
    assert loop.call('plant_sim', 'reset').success
    assert node.values == before


def test_a_parameter_of_no_type_ends_no_node(loop: RosLoop) -> None:
    from rcl_interfaces.msg import Parameter, ParameterValue
    from rcl_interfaces.srv import SetParameters

    node = start(loop, 'plant_sim')
    client: Any = loop.observer.create_client(SetParameters, 'plant_sim/set_parameters')
    loop.until(client.service_is_ready)
    answer = client.call_async(SetParameters.Request(parameters=[
        Parameter(name='payload', value=ParameterValue(type=42))]))
    loop.until(answer.done)
    assert not answer.result().results
    loop.observer.destroy_client(client)
    result, = setting(loop, 'plant_sim', payload=0.25)
    assert result.successful
    assert node.values['payload'] != 0.25, 'it waits for a reset'


def test_a_command_limit_holds_from_the_next_command_on(loop: RosLoop) -> None:
    bench = Bench(loop, 'controller')
    for k in range(3):
        bench.answered(k, angle=(-0.5, -0.5))
    assert np.abs(bench.answers[-1].effort).max() > 0.1
    assert setting(loop, 'lqg_controller', command_limit=0.1)[0].successful
    for k in range(3, 8):
        bench.answered(k, angle=(-0.5, -0.5))
        assert np.abs(bench.answers[-1].effort).max() <= 0.1
    assert np.abs(bench.answers[-1].effort).max() == 0.1
    assert setting(loop, 'lqg_controller', command_limit=5.0, command_slew=20.0)[0].successful
    bench.answered(8, angle=(-1.5, -1.5))
    step = np.abs(np.subtract(bench.answers[-1].effort, bench.answers[-2].effort))
    assert step.max() == pytest.approx(0.2), '20 units/s over 10 ms'


def test_a_payload_takes_effect_at_the_reset(loop: RosLoop) -> None:
    node = start(loop, 'plant_sim')
    assert setting(loop, 'plant_sim', payload=0.3)[0].successful
    assert node.simulator.mass(0.0) == 0.1
    assert loop.call('plant_sim', 'reset').success
    assert node.simulator.mass(0.0) == 0.3


def test_what_changes_nothing_is_said(loop: RosLoop) -> None:
    """With `rpe` the constants of SF1 were accepted, and said to be in force after the reset."""
    from flex_payload_estimator.nodes.payload_estimator_node import PayloadEstimatorNode

    node = loop.start(PayloadEstimatorNode, model='assumed_modes', modes=1, estimator='rpe')
    assert node.parameter_status().message == 'ok'
    assert setting(loop, 'payload_estimator', payload_initial=0.3)[0].successful
    assert node.parameter_status().message == (
        'payload_initial: in force after ~/reset; '
        'payload_initial changes nothing with estimator rpe')
    assert loop.call('payload_estimator', 'reset').success
    assert node.parameter_status().message == 'payload_initial changes nothing with estimator rpe'
    assert setting(loop, 'payload_estimator', estimator='sf1')[0].successful
    assert node.parameter_status().message == 'estimator: in force after ~/reset'


def test_the_generated_file_and_the_documented_effect_start_every_node(
    ros_context: Context, tmp_path: Path,
) -> None:
    from rclpy.node import Node

    (tmp_path / 'parameters.yaml').write_text(parameter_file())
    for name, table in load_parameters().items():
        node = Node(name, context=ros_context, cli_args=[
            '--ros-args', '--params-file', str(tmp_path / 'parameters.yaml'),
            '-p', 'effects:=coulomb_friction:joint_2:level=0.4'])
        given = node._parameter_overrides
        assert set(given) >= {row.name for row in table.values() if row.default != ()}
        for row in table.values():
            if row.default != ():
                assert row.check(given[row.name].value) == row.default
                assert type(given[row.name].value) is type(row.default)
        node.destroy_node()


def test_plant_sim_takes_an_effect_as_the_table_writes_it(loop: RosLoop) -> None:
    from flex_plant_sim.nodes.plant_sim_node import PlantSim

    node = loop.start(PlantSim, effects='coulomb_friction:joint_2:level=0.4',
                      coriolis=False)
    effect, = node.simulator.arm.effects
    assert (effect.identifier, effect.site) == ('coulomb_friction', 'joint_2')
    assert effect['level_n_m'] == 0.4


def test_a_slip_of_the_pen_is_named(loop: RosLoop) -> None:
    from msg_config.ros import unknown_overrides

    depth = 'qos_overrides./strain.publisher.dept'
    node = loop.start(type(start(loop, 'plant_sim')), **PAPER, paylod=0.3, **{depth: 3})
    assert unknown_overrides(node) == [
        'plant_sim: paylod: unknown parameter, not used; did you mean payload?',
        f'plant_sim: {depth}: unknown parameter, not used; did you mean {depth}h?']


def test_a_slip_of_the_pen_while_the_node_runs_is_named(loop: RosLoop) -> None:
    start(loop, 'plant_sim')
    result, = setting(loop, 'plant_sim', paylod=0.3)
    assert not result.successful
    assert result.reason == 'plant_sim: paylod: unknown parameter; did you mean payload?'


def test_a_publisher_keeps_its_last_message_where_it_is_told_to(loop: RosLoop) -> None:
    from flex_plant_sim.nodes.plant_sim_node import PlantSim
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from sensor_msgs.msg import JointState

    name = 'qos_overrides./strain.publisher.durability'
    loop.start(PlantSim, **PAPER, **{name: 'transient_local'})
    found: list[JointState] = []
    loop.observer.create_subscription(JointState, 'strain', found.append, QoSProfile(
        depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    loop.until(lambda: bool(found))


def test_a_waiting_change_that_is_taken_back_is_logged_as_such(
        loop: RosLoop, capfd: pytest.CaptureFixture[str]) -> None:
    start(loop, 'payload_estimator')
    for modes, text in ((1, 'modes: in force after ~/reset'), (2, 'no change waits')):
        assert setting(loop, 'payload_estimator', modes=modes)[0].successful
        assert capfd.readouterr().err.splitlines()[-1].endswith(f'[payload_estimator]: {text}')
