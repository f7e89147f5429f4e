"""The topic contract, the parameter table and their rclpy side."""

from __future__ import annotations

from array import array
from functools import partial
import math
from pathlib import Path
import time
from typing import Any, TYPE_CHECKING

from flex_plant_sim.arm.file_section import PLAUSIBLE
from flex_plant_sim.tools.command_line import LARGEST_MASS
from msg_config import contract
from msg_config.contract import load_services, load_topics
from msg_config.errors import InputError
from msg_config.parameters import (
    check_parameters,
    load_parameters,
    page,
    parameter_file,
)
import pytest
import yaml

if TYPE_CHECKING:
    from rclpy.context import Context

# Independent copy of the contract's names and types, as users of the topics were told.
CONTRACT = {
    'joint_states': 'sensor_msgs/msg/JointState',
    'strain': 'sensor_msgs/msg/JointState',
    'command': 'sensor_msgs/msg/JointState',
    'reference': 'trajectory_msgs/msg/JointTrajectory',
    'payload': 'std_msgs/msg/Float64MultiArray',
    'payload_stamped': 'sensor_msgs/msg/JointState',
    'payload/inertia': 'geometry_msgs/msg/InertiaStamped',
    'innovation': 'sensor_msgs/msg/JointState',
    '/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
    'arm_markers': 'visualization_msgs/msg/MarkerArray',
    '/clock': 'rosgraph_msgs/msg/Clock',
}
NODES = ('plant_sim', 'payload_estimator', 'lqg_controller')
MASS = 'expected a number from 0 to 1000 kg, or -1'


def test_topics_are_the_contract() -> None:
    assert {name: topic.type for name, topic in load_topics().items()} == CONTRACT


def test_every_topic_is_published_reliably_and_only_the_payload_is_kept_for_late_subscribers(
) -> None:
    for name, topic in load_topics().items():
        assert (topic.qos.reliability, topic.qos.depth) == ('reliable', 10)
        kept = 'transient_local' if name == 'payload' else 'volatile'
        assert topic.qos.durability == topic.subscribe.durability == kept
        assert topic.subscribe.reliability == ('reliable' if name == 'payload' else 'best_effort')


def test_interfaces_exist_and_have_the_fields_that_the_contract_names() -> None:
    from msg_config.ros import interface_class

    for service in load_services().values():
        assert interface_class(service.type).Request is not None
    for topic in load_topics().values():
        if topic.name == 'payload':  # labels of an array, not message fields
            continue
        fields = interface_class(topic.type).get_fields_and_field_types()
        for field in topic.fields:
            assert field.split('.')[0] in fields, f'{topic.name}: {field}'


def test_payload_message_labels_its_values() -> None:
    from msg_config.ros import payload_message

    message = payload_message(0.1, 4e-6, 2.0)
    assert [dim.label for dim in message.layout.dim] == ['mass kg', 'variance kg^2', 'P kg^2']
    assert list(message.data) == [0.1, 4e-6, 2.0]


@pytest.mark.ros
def test_what_is_written_into_serialised_messages_is_what_comes_out() -> None:
    from geometry_msgs.msg import InertiaStamped
    from msg_config.messages import inertia_message, joint_state
    from msg_config.ros import payload_message, PayloadPublisher
    import rclpy
    from rclpy.serialization import deserialize_message
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Float64MultiArray

    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node('payload_estimator', context=context)
    stamp = 7_000_000_123
    payload, inertia, stamped = PayloadPublisher(node).serialised(stamp, 0.1, 4e-6, 2.0)
    assert deserialize_message(stamped, JointState) == joint_state(
        stamp, ['payload'], [0.1], effort=[4e-6])
    assert deserialize_message(payload, Float64MultiArray) == payload_message(0.1, 4e-6, 2.0)
    assert deserialize_message(inertia, InertiaStamped) == inertia_message(stamp, 0.1)
    node.destroy_node()
    rclpy.shutdown(context=context)


@pytest.mark.parametrize('node', NODES)
def test_defaults_satisfy_their_own_rows(node: str) -> None:
    table = load_parameters()[node]
    assert check_parameters(node, {}) == {name: row.default for name, row in table.items()}


def test_defaults_and_choices_are_those_of_the_library() -> None:
    from flex_payload_estimator.control.lqg import LQGSettings
    from flex_payload_estimator.estimators.factory import BUILDERS
    from flex_payload_estimator.estimators.sf1.settings import DEFAULT_SETTINGS
    from flex_payload_estimator.nodes.node_setup import controller_of, estimator_of
    from flex_plant_sim.arm.models import DEFAULT_MODEL, DEFAULT_MODES, MODELS

    for table in load_parameters().values():
        assert (table['model'].default, table['modes'].default) == (DEFAULT_MODEL, DEFAULT_MODES)
        assert tuple(table['model'].choices) == tuple(MODELS)
    rows = load_parameters()['payload_estimator']
    assert tuple(rows['estimator'].choices) == tuple(BUILDERS)
    estimator: Any = estimator_of(check_parameters('payload_estimator', {
        'estimator': 'sf1', 'modes': 2}))
    assert estimator.settings == DEFAULT_SETTINGS
    controller = controller_of(check_parameters('lqg_controller', {'modes': 2}))
    assert controller.settings == LQGSettings(integrator=True, command_limit=5.0)


@pytest.mark.parametrize('node', NODES)
def test_what_a_parameter_needs_are_choices_of_its_node(node: str) -> None:
    table = load_parameters()[node]
    for row in table.values():
        for name, choices in row.needs.items():
            assert all(table[name].check(choice) == choice for choice in choices)
        assert not row.unmet({name: choices[0] for name, choices in row.needs.items()})


def test_parameter_file_holds_every_default() -> None:
    content = yaml.safe_load(parameter_file())
    for node in NODES:
        values = content[node]['ros__parameters']
        assert check_parameters(node, values) == check_parameters(node, {})
        assert list(values) == [
            name for name, row in load_parameters()[node].items() if row.default != ()]


def test_an_int_becomes_a_double() -> None:
    payload = check_parameters('plant_sim', {'payload': 1})['payload']
    assert payload == 1.0
    assert isinstance(payload, float)


@pytest.mark.parametrize(('values', 'message'), [
    ({'payload': -2}, f'plant_sim: payload: {MASS}, got -2'),
    ({'payload': math.nan}, f'plant_sim: payload: {MASS}, got nan'),
    ({'payload': -0.5}, f'plant_sim: payload: {MASS}, got -0.5'),
    ({'payload': True}, f'plant_sim: payload: {MASS}, got True'),
    ({'seed': -1}, 'plant_sim: seed: expected an integer from 0 to 4294967295, got -1'),
    ({'modes': 2.0}, 'plant_sim: modes: expected an integer from 1 to 20, got 2.0'),
    ({'mode': 'fast'}, "plant_sim: mode: expected lockstep or realtime, got 'fast'"),
    ({'effects': 7}, 'plant_sim: effects: expected a list of texts, got 7'),
    ({'payload_schedule': [1.0, 'a']},
     "plant_sim: payload_schedule: expected a list of numbers s, kg, got [1.0, 'a']"),
    ({'payload_schedule': array('d', [math.nan, 0.1])},
     'plant_sim: payload_schedule: expected a list of numbers s, kg, got [nan, 0.1]'),
])
def test_bad_values_are_refused_in_one_line(values: dict[str, object], message: str) -> None:
    with pytest.raises(InputError) as raised:
        check_parameters('plant_sim', values)
    assert str(raised.value) == message


def test_an_unknown_parameter_is_named_with_those_that_exist() -> None:
    with pytest.raises(InputError, match=r'^plant_sim: mass: unknown parameter, expected one of '
                                         r'robot, .*payload.*$'):
        check_parameters('plant_sim', {'mass': 0.1})


def test_the_docs_hold_exactly_the_tables(repository: Path) -> None:
    for name, made in (('parameters', page()), ('topics', contract.page())):
        assert made == (repository / f'docs/{name}.md').read_text(encoding='utf-8')


def _node(context: Context, name: str, **overrides: Any) -> Any:
    from rclpy.node import Node
    from rclpy.parameter import Parameter

    return Node(name, context=context, parameter_overrides=[
        Parameter(key, value=value) for key, value in overrides.items()])


def test_the_largest_payload_is_the_same_everywhere() -> None:
    """What a tool or a robot file takes, a node takes."""
    assert LARGEST_MASS == PLAUSIBLE['mass_kg'][1]
    rows = [row for table in load_parameters().values() for row in table.values()
            if row.unit == 'kg']
    assert len(rows) == 5
    assert {row.maximum for row in rows} == {LARGEST_MASS}


@pytest.mark.parametrize('node', NODES)
def test_the_sample_time_is_what_a_robot_file_may_say(node: str) -> None:
    row = load_parameters()[node]['sample_time']
    assert (row.minimum, row.maximum) == PLAUSIBLE['sample_time_s']
    assert row.check(0.0) == 0.0
    with pytest.raises(InputError, match='^sample_time: expected a number from 1e-05 to 1 s, or 0,'
                                         ' got 9e-06$'):
        row.check(9e-6)


@pytest.mark.ros
@pytest.mark.parametrize('name', NODES)
def test_nodes_declare_the_whole_table(ros_context: Context, name: str) -> None:
    from msg_config.ros import declare_parameters

    node = _node(ros_context, name)
    assert declare_parameters(node) == check_parameters(name, {})
    for row in load_parameters()[name].values():
        described = node.describe_parameter(row.name)
        assert described.description.startswith(row.description)
        ranges = [*described.integer_range, *described.floating_point_range]
        assert [(span.from_value, span.to_value) for span in ranges] == (
            [] if row.minimum is None else [
                (row.minimum if row.special is None else row.special, row.maximum)])
    node.destroy_node()


@pytest.mark.ros
def test_a_node_takes_an_int_for_a_double_at_the_start(ros_context: Context) -> None:
    from msg_config.ros import declare_parameters, parameter_values

    node = _node(ros_context, 'plant_sim', payload=1, payload_schedule=[1, 0])
    values = declare_parameters(node)
    assert (values['payload'], values['payload_schedule']) == (1.0, (1.0, 0.0))
    assert parameter_values(node) == values
    node.destroy_node()


@pytest.mark.ros
@pytest.mark.parametrize(('name', 'value'), [
    ('payload', -1.5), ('payload', -2), ('payload', 'heavy'), ('mode', 'fast'), ('modes', 0),
    ('modes', 2.5), ('effects', [1.0]),
])
def test_a_node_refuses_what_the_table_refuses(
    ros_context: Context, name: str, value: Any,
) -> None:
    from msg_config.ros import declare_parameters

    refused = _node(ros_context, 'plant_sim', **{name: value})
    with pytest.raises(InputError, match=f'^plant_sim: .*{name}') as raised:
        declare_parameters(refused)
    assert '\n' not in str(raised.value)
    refused.destroy_node()


def _note(received: set[str], name: str, _: Any) -> None:
    received.add(name)


@pytest.mark.ros
@pytest.mark.parametrize('reliable', [False, True])
def test_every_topic_reaches_a_subscription(ros_context: Context, reliable: bool) -> None:
    from msg_config.ros import create_publisher, create_subscription, interface_class
    from rclpy.executors import SingleThreadedExecutor

    node = _node(ros_context, 'contract')
    executor = SingleThreadedExecutor(context=ros_context)
    executor.add_node(node)
    received: set[str] = set()
    publishers = {name: create_publisher(node, name) for name in CONTRACT}
    subscriptions = [
        create_subscription(node, name, partial(_note, received, name), reliable=reliable)
        for name in CONTRACT]
    deadline = time.monotonic() + 30.0
    while received != set(CONTRACT) and time.monotonic() < deadline:
        for name, publisher in publishers.items():
            publisher.publish(interface_class(CONTRACT[name])())
        for _ in subscriptions:
            executor.spin_once(timeout_sec=0.05)
    executor.shutdown()
    node.destroy_node()
    assert received == set(CONTRACT)


@pytest.mark.ros
def test_a_late_subscriber_gets_the_last_payload(ros_context: Context) -> None:
    from msg_config.ros import create_publisher, create_subscription, payload_message
    from rclpy.executors import SingleThreadedExecutor

    node = _node(ros_context, 'late')
    create_publisher(node, 'payload').publish(payload_message(0.1, 1e-6, 2.0))
    late = _node(ros_context, 'late_subscriber')
    masses: list[float] = []
    create_subscription(late, 'payload', lambda message: masses.append(message.data[0]))
    executor = SingleThreadedExecutor(context=ros_context)
    executor.add_node(late)
    deadline = time.monotonic() + 30.0
    while not masses and time.monotonic() < deadline:
        executor.spin_once(timeout_sec=0.1)
    executor.shutdown()
    node.destroy_node()
    late.destroy_node()
    assert masses == [0.1]


@pytest.mark.ros
def test_qos_can_be_overridden_by_parameters(ros_context: Context) -> None:
    from msg_config.ros import create_publisher
    from rclpy.qos import ReliabilityPolicy

    node = _node(ros_context, 'override', **{
        'qos_overrides./strain.publisher.reliability': 'best_effort',
        'qos_overrides./strain.publisher.depth': 3})
    profile = create_publisher(node, 'strain').qos_profile
    assert (profile.reliability, profile.depth) == (ReliabilityPolicy.BEST_EFFORT, 3)
    node.destroy_node()
