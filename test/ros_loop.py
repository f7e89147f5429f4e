"""Nodes in this process under one EventsExecutor, and an observer that drives the tests."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from msg_config.contract import load_services, load_topics
from msg_config.messages import stamp_of
from msg_config.node_process import make_executor
from msg_config.ros import create_publisher, create_subscription, interface_class, qos_profile
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.task import Future

# Longest wait for a condition or a service, s.
TIMEOUT = 60.0


def overrides(values: dict[str, Any]) -> list[Parameter[Any]]:
    """Return parameter overrides."""
    return [Parameter(name, value=value) for name, value in values.items()]


class Recording(list[Any]):
    """Messages of a topic in order of arrival, and the stamps seen, ns."""

    def __init__(self) -> None:
        super().__init__()
        self.stamps: set[int] = set()

    def take(self, message: Any) -> None:
        """Append a message."""
        self.append(message)
        if hasattr(message, 'header'):
            self.stamps.add(stamp_of(message))

    def clear(self) -> None:
        """Forget all messages and stamps."""
        super().clear()
        self.stamps.clear()

    def by_stamp(self, start: int = 0) -> dict[int, Any]:
        """Return the messages from index `start` on by stamp; repeated ones must be equal."""
        found: dict[int, Any] = {}
        for message in self[start:]:
            assert found.setdefault(stamp_of(message), message) == message
        return found


class RosLoop:
    """Owns the executor, the nodes given to it, and an observer that records topics."""

    def __init__(self, context: Context):
        self.context = context
        self.executor = make_executor(context)
        self.observer = Node('observer', context=context)
        self.executor.add_node(self.observer)
        self.nodes: list[Node] = [self.observer]
        self._condition: Callable[[], bool] | None = None
        self._stop: Future[Any] = Future()
        self.observer.create_timer(0.02, self._check, clock=Clock(
            clock_type=ClockType.STEADY_TIME))

    def start(self, kind: Callable[..., Node], **values: Any) -> Any:
        """Add a node with parameters."""
        return self.add(kind, parameter_overrides=overrides(values))

    def add(self, kind: Callable[..., Node], *arguments: Any, **options: Any) -> Any:
        """Build a node with these arguments and add it."""
        node = kind(*arguments, context=self.context, **options)
        self.executor.add_node(node)
        self.nodes.append(node)
        return node

    def stop(self, node: Node) -> None:
        """Remove and destroy a node, after what is queued for it is done."""
        self.executor.remove_node(node)
        self.wait(0.1)
        self.nodes.remove(node)
        node.destroy_node()

    def record(self, topic: str, name: str | None = None) -> Recording:
        """Return a list to which a topic's messages will be appended; `name` if it is remapped."""
        messages = Recording()

        def take(message: Any) -> None:
            messages.take(message)
            self._check()
        if name is None:
            create_subscription(self.observer, topic, take)
        else:
            contract = load_topics()[topic]
            self.observer.create_subscription(
                interface_class(contract.type), name, take, qos_profile(contract.qos))
        return messages

    def publisher(self, topic: str) -> Publisher:
        """Return a publisher on a topic, once a subscription has found it."""
        publisher = create_publisher(self.observer, topic)
        self.until(lambda: publisher.get_subscription_count() > 0)
        return publisher

    def until(self, condition: Callable[[], bool], timeout: float = TIMEOUT) -> None:
        """Run until a condition holds, checked at every recorded message; fail at the time-out."""
        self._condition, self._stop = condition, Future()
        self._check()
        if not self._stop.done():
            self.executor.spin_until_future_complete(self._stop, timeout_sec=timeout)
        self._condition = None
        assert condition(), f'did not come true within {timeout} s'

    def wait(self, time: float) -> None:
        """Run for a time, s, on the wall clock."""
        self.executor.spin_until_future_complete(Future(), timeout_sec=time)

    def call(self, node: str, service: str, **request: Any) -> Any:
        """Call a node's service and return the response."""
        kind = interface_class(load_services()[f'~/{service}'].type)
        client: Any = self.observer.create_client(kind, f'{node}/{service}')
        self.until(client.service_is_ready)
        future = client.call_async(kind.Request(**request))
        self.executor.spin_until_future_complete(future, timeout_sec=TIMEOUT)
        assert future.done()
        self.observer.destroy_client(client)
        return future.result()

    def close(self) -> None:
        """Destroy all, after what is queued is done: a late event would find no node."""
        for node in self.nodes:
            self.executor.remove_node(node)
        self.wait(0.02)
        self.executor.shutdown()
        for node in self.nodes:
            node.destroy_node()

    def _check(self) -> None:
        if self._condition is not None and not self._stop.done() and self._condition():
            self._stop.set_result(None)
