"""The contract in rclpy: message classes, QoS, publishers, subscriptions and parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from struct import Struct
from typing import Any

from msg_config import load_services, load_topics, Qos
from msg_config.errors import InputError
from msg_config.messages import inertia_message, NANOSECONDS
from msg_config.parameters import load_parameters, Parameter, Value
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.serialization import serialize_message
from rclpy.service import Service
from rclpy.subscription import Subscription
from std_msgs.msg import Float64MultiArray, MultiArrayDimension


def interface_class(interface: str) -> Any:
    """Return the class of ``package/msg/Name`` or ``package/srv/Name``."""
    package, kind, name = interface.split('/')
    return getattr(import_module(f'{package}.{kind}'), name)


def qos_profile(qos: Qos) -> QoSProfile:
    """Return the rclpy profile of a contract entry."""
    return QoSProfile(
        depth=qos.depth,
        reliability=ReliabilityPolicy[qos.reliability.upper()],
        durability=DurabilityPolicy[qos.durability.upper()],
    )


def create_publisher(node: Node, name: str) -> Publisher:
    """Return a publisher of the topic; its QoS can be overridden by parameters."""
    topic = load_topics()[name]
    return node.create_publisher(
        interface_class(topic.type), topic.name, qos_profile(topic.qos),
        qos_overriding_options=QoSOverridingOptions.with_default_policies())


def create_subscription(
    node: Node, name: str, callback: Callable[[Any], None], *, reliable: bool = False,
) -> Subscription:
    """
    Return a subscription to the topic; its QoS can be overridden by parameters.

    Parameters
    ----------
    node : Node
        The subscribing node.
    name : str
        Name in the contract.
    callback : callable
        Takes the message.
    reliable : bool
        Ask for the publisher's own QoS, as lock-step must: there one lost message stops the
        loop. By default any publisher is accepted, a best-effort one included.

    """
    topic = load_topics()[name]
    return node.create_subscription(
        interface_class(topic.type), topic.name, callback,
        qos_profile(topic.qos if reliable else topic.subscribe),
        qos_overriding_options=QoSOverridingOptions.with_default_policies())


def create_service(node: Node, name: str, callback: Callable[[Any, Any], Any]) -> Service:
    """Return the service ``name`` of the contract."""
    service = load_services()[name]
    return node.create_service(interface_class(service.type), service.name, callback)


def payload_message(mass: float, variance: float, p: float) -> Float64MultiArray:
    """Return the payload message: kg, kg^2 and SF1's P, one labelled dimension each."""
    message = Float64MultiArray(data=[mass, variance, p])
    message.layout.dim = [
        MultiArrayDimension(label=f'{name} {field.unit}', size=1, stride=1)
        for name, field in load_topics()['payload'].fields.items()]
    return message


class PayloadPublisher:
    """
    Publishes payload, and payload/inertia of the same stamp.

    Somebody waits for them: what never changes is serialised once, and at every sample only
    the numbers are written into it, which halves the time.

    Parameters
    ----------
    node : Node

    """

    def __init__(self, node: Node):
        self._payload = create_publisher(node, 'payload')
        self._inertia = create_publisher(node, 'payload/inertia')
        # The numbers stand last; stamp and mass stand before and after the frame's name.
        self._numbers = Struct('=3d').pack
        self._labels = bytes(serialize_message(payload_message(0.0, 0.0, 0.0)))[:-24]
        whole = bytes(serialize_message(inertia_message(0, 0.0)))
        self._head, self._frame, self._rest = whole[:4], whole[12:20], whole[28:]
        self._stamp, self._mass = Struct('=iI').pack, Struct('=d').pack

    def serialised(self, stamp: int, mass: float, variance: float, p: float
                   ) -> tuple[bytes, bytes]:
        """Return both messages of a stamp, ns, as they are sent: kg, kg^2 and SF1's P."""
        return (self._labels + self._numbers(mass, variance, p),
                self._head + self._stamp(*divmod(stamp, NANOSECONDS)) + self._frame
                + self._mass(mass) + self._rest)

    def publish(self, messages: tuple[bytes, bytes]) -> None:
        """Publish what `serialised` gave."""
        self._payload.publish(messages[0])
        self._inertia.publish(messages[1])


def descriptor(row: Parameter) -> ParameterDescriptor:
    """Return the ROS description of a parameter: text, unit, choices and range."""
    unit = f' [{row.unit}]' if row.unit else ''
    result = ParameterDescriptor(
        description=row.description + unit,
        additional_constraints=f'expected {row.expected}',
        # A static double refuses an int, which is what `payload: 1` is.
        dynamic_typing=row.type in ('double', 'double_array', 'string_array'),
    )
    if row.minimum is not None and row.maximum is not None:
        if row.type == 'int':
            result.integer_range = [IntegerRange(
                from_value=int(row.minimum), to_value=int(row.maximum), step=1)]
        else:
            result.floating_point_range = [FloatingPointRange(
                from_value=row.minimum, to_value=row.maximum)]
    return result


def declare_parameters(node: Node, table: str | None = None) -> dict[str, Value]:
    """
    Declare a node's table and return its values, overrides included.

    From then on a change that the table does not accept is refused with the table's reason.

    Parameters
    ----------
    node : Node
        The node, without these parameters yet.
    table : str, optional
        Name of the table, by default the node's name.

    Raises
    ------
    InputError
        If an override does not fit the table.

    """
    rows = load_parameters()[table or node.get_name()]
    try:
        node.declare_parameters('', [
            (row.name, _default(row), descriptor(row)) for row in rows.values()])
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        raise InputError(f'{node.get_name()}: {error}') from None
    values = parameter_values(node, table)
    node.add_on_set_parameters_callback(lambda changes: _verdict(rows, changes))
    return values


def parameter_values(node: Node, table: str | None = None) -> dict[str, Value]:
    """
    Return the present values of a declared table in the table's types.

    Raises
    ------
    InputError
        If a value does not fit the table.

    """
    rows = load_parameters()[table or node.get_name()]
    try:
        return {name: row.check(_value(node.get_parameter(name))) for name, row in rows.items()}
    except InputError as error:
        raise InputError(f'{node.get_name()}: {error}') from None


def _default(row: Parameter) -> Any:
    return list(row.default) if isinstance(row.default, tuple) else row.default


def _value(parameter: RosParameter[Any]) -> Any:
    # An empty list has no element type: rclpy calls it a byte array.
    return () if parameter.value in ([], (), b'') else parameter.value


def _verdict(
    rows: Mapping[str, Parameter], changes: list[RosParameter[Any]],
) -> SetParametersResult:
    try:
        for change in changes:
            if change.name in rows:
                rows[change.name].check(_value(change))
    except InputError as error:
        return SetParametersResult(successful=False, reason=str(error))
    return SetParametersResult(successful=True)
