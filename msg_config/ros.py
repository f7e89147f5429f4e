"""Applies the contract in rclpy: message classes, QoS, publishers, subscriptions, parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from importlib import import_module
import inspect
from time import monotonic, time_ns
from typing import Any

from msg_config.contract import load_services, load_topics, Qos
from msg_config.errors import InputError
from msg_config.messages import inertia_message, joint_state, NANOSECONDS
from msg_config.parameters import APPLIES, load_parameters, Parameter, Value
from msg_config.wire import MessageWriter
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
)
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.service import Service
from rclpy.subscription import Subscription
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

# Least interval, s, of asking the middleware for subscribers; discovery takes longer.
LOOK_INTERVAL = 0.01
# Policies that parameters may override.
OVERRIDABLE = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY,
               QoSPolicyKind.DURABILITY)
_MESSAGE_AND_INFO = inspect.signature(lambda message, info: None)


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


@contextmanager
def _named_overrides(node: Node, topic: str) -> Iterator[None]:
    """Raise InputError if an override of a topic's QoS is invalid; rclpy has no class for it."""
    try:
        yield
    except RuntimeError as error:
        raise InputError(f'{node.get_name()}: qos_overrides of {topic}: {error}') from None


def create_publisher(node: Node, name: str) -> Publisher:
    """Return a publisher of the topic; its QoS can be overridden by parameters."""
    topic = load_topics()[name]
    with _named_overrides(node, name):
        return node.create_publisher(
            interface_class(topic.type), topic.name, qos_profile(topic.qos),
            qos_overriding_options=QoSOverridingOptions(OVERRIDABLE))


def create_subscription(
    node: Node, name: str, callback: Callable[..., None], *, reliable: bool = False,
    raw: bool = False,
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
        Called with the message.
    reliable : bool
        Whether to request the publisher's own QoS, as in lock-step, where one lost message stops
        the loop. By default any publisher is accepted, including a best-effort one.
    raw : bool
        Whether the callback takes the message's bytes, for a `wire.MessageReader`.

    """
    topic = load_topics()[name]
    with _named_overrides(node, name):
        return node.create_subscription(
            interface_class(topic.type), topic.name, callback,
            qos_profile(topic.qos if reliable else topic.subscribe), raw=raw,
            qos_overriding_options=QoSOverridingOptions(OVERRIDABLE))


def create_sourced_subscription(
    node: Node, name: str, callback: Callable[[Any, bytes | None, float], None], *,
    raw: bool = False,
) -> Subscription:
    """
    Return a subscription whose callback also takes the source of the message and its waiting time.

    Its arguments are the message, or its bytes, the publisher's gid, None if the middleware gives
    none, and the time that the message has waited here, s. An EventsExecutor passes message and
    info as one tuple, other executors as two arguments; rclpy needs the signature to know that the
    callback takes two.
    """
    def taken(*arguments: Any) -> None:
        message, info = arguments if len(arguments) == 2 else arguments[0]
        gid, now = info.get('publisher_gid'), time_ns()
        waited = max(now - info.get('received_timestamp', now), 0)
        callback(message, gid and gid['data'], waited / NANOSECONDS)
    taken.__signature__ = _MESSAGE_AND_INFO  # type: ignore[attr-defined]
    return create_subscription(node, name, taken, raw=raw)


def silent_topic(node: Node, topic: str) -> str:
    """Return the whole name of a topic without messages, and what is wrong with its publishers."""
    name, own = node.resolve_topic_name(topic), load_topics()[topic].type
    kinds = {info.topic_type for info in node.get_publishers_info_by_topic(name)}
    others = f' (expected {own}, got {", ".join(sorted(kinds))})' if kinds - {own} else ''
    return name + (others if kinds else ' (no publisher)')


def create_service(node: Node, name: str, callback: Callable[[Any, Any], Any]) -> Service:
    """Return the service ``name`` of the contract."""
    service = load_services()[name]
    return node.create_service(interface_class(service.type), service.name, callback)


def payload_message(mass: float, variance: float, p: float) -> Float64MultiArray:
    """Return the payload message: mass, kg, variance, kg^2, and SF1's P, each with a label."""
    message = Float64MultiArray(data=[mass, variance, p])
    message.layout.dim = [
        MultiArrayDimension(label=f'{name} {field.unit}', size=1, stride=1)
        for name, field in load_topics()['payload'].fields.items()]
    return message


class Audience:
    """
    Whether a publisher has subscribers, looked up at most every LOOK_INTERVAL.

    Asking the middleware at every sample would take as long as sending a message.

    Parameters
    ----------
    publisher : Publisher

    """

    def __init__(self, publisher: Publisher):
        self._publisher, self._looked, self._there = publisher, -LOOK_INTERVAL, False

    def __bool__(self) -> bool:
        """Return whether there are subscribers."""
        now = monotonic()
        if now - self._looked >= LOOK_INTERVAL:
            self._looked, self._there = now, self._publisher.get_subscription_count() > 0
        return self._there


class PayloadPublisher:
    """
    Publishes payload, payload/inertia and payload_stamped with the same stamp.

    The controller waits for payload/inertia. The third is sent after both, and only if it has
    subscribers.

    Parameters
    ----------
    node : Node
    prefix : str
        Before the name of the tip's frame.

    """

    def __init__(self, node: Node, prefix: str = ''):
        self._publishers = [create_publisher(node, name)
                            for name in ('payload', 'payload/inertia', 'payload_stamped')]
        self._audience = Audience(self._publishers[2])
        self._payload = MessageWriter(payload_message(0.0, 0.0, 0.0), 'data')
        self._inertia = MessageWriter(inertia_message(0, 0.0, prefix), 'header', 'inertia.m')
        self._stamped = MessageWriter(joint_state(0, ('payload',), (0.0,), effort=(0.0,)),
                                      'header', 'position', 'effort')

    def serialised(self, stamp: int, mass: float, variance: float, p: float
                   ) -> tuple[bytes, bytes, bytes]:
        """Return the messages of a stamp, ns: mass, kg, variance, kg^2, and SF1's P."""
        time = divmod(stamp, NANOSECONDS)
        return (self._payload(mass, variance, p), self._inertia(*time, mass),
                self._stamped(*time, mass, variance))

    def publish(self, messages: tuple[bytes, bytes, bytes]) -> None:
        """Publish the messages that `serialised` returned."""
        payload, inertia, stamped = self._publishers
        payload.publish(messages[0])
        inertia.publish(messages[1])
        if self._audience:
            stamped.publish(messages[2])


def descriptor(row: Parameter) -> ParameterDescriptor:
    """Return the ROS description of a parameter: text, unit, choices and range."""
    unit = f' [{row.unit}]' if row.unit else ''
    result = ParameterDescriptor(
        description=row.meaning + unit,
        additional_constraints=f'expected {row.expected}; a change applies '
                               + APPLIES[row.applies].replace('`', ''),
        # A statically typed double would refuse an int such as `payload: 1`, and the errors of the
        # table are clearer than those of ROS.
        dynamic_typing=True,
    )
    if row.minimum is not None and row.maximum is not None:
        if row.type == 'int':
            result.integer_range = [IntegerRange(
                from_value=int(row.minimum), to_value=int(row.maximum), step=1)]
        else:
            result.floating_point_range = [FloatingPointRange(
                from_value=row.minimum if row.special is None else row.special,
                to_value=row.maximum)]
    return result


def declare_parameters(node: Node, table: str | None = None) -> dict[str, Value]:
    """
    Declare a node's table and return its values, including overrides.

    Parameters
    ----------
    node : Node
        The node, without these parameters yet.
    table : str, optional
        Name of the table, by default the node's name.

    Raises
    ------
    InputError
        An override does not fit the table.

    """
    rows = load_parameters()[table or node.get_name()]
    try:
        node.declare_parameters('', [
            (row.name, _default(row), descriptor(row)) for row in rows.values()])
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        raise InputError(f'{node.get_name()}: {error}') from None
    return parameter_values(node, table)


def parameter_values(node: Node, table: str | None = None) -> dict[str, Value]:
    """
    Return the present values of a declared table in the table's types.

    Raises
    ------
    InputError
        A value does not fit the table.

    """
    rows = load_parameters()[table or node.get_name()]
    try:
        return {name: row.check(parameter_value(node.get_parameter(name)))
                for name, row in rows.items()}
    except InputError as error:
        raise InputError(f'{node.get_name()}: {error}') from None


def _default(row: Parameter) -> Any:
    return list(row.default) if isinstance(row.default, tuple) else row.default


def parameter_value(parameter: RosParameter[Any]) -> Any:
    """Return a value; rclpy takes an empty list, which has no element type, for a byte array."""
    return () if parameter.value in ([], (), b'') else parameter.value


def unknown_parameter(node: Node, name: str) -> list[str]:
    """Return what to say of a parameter that a node does not have: likely misspelt."""
    near = get_close_matches(name, node._parameters, 1)
    return [f'{node.get_name()}: {name}: unknown parameter',
            *(f'did you mean {found}?' for found in near)]


def unknown_overrides(node: Node) -> list[str]:
    """Return a line for each given parameter that the node does not have, once it is complete."""
    return ['; '.join([f'{text}, not used', *hint])
            for name in node._parameter_overrides if not node.has_parameter(name)
            for text, *hint in [unknown_parameter(node, name)]]
