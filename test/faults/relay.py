"""A node between the plant and the others that passes messages on and alters some of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from msg_config.contract import load_topics
from msg_config.messages import stamp_of
from msg_config.ros import create_publisher, interface_class, qos_profile
from rclpy.node import Node

# Prefix of the topics before the relay.
RAW = 'raw/'
# Called with a message and a function that sends one. It may send none, several, others, or later.
Alter = Callable[[Any, Callable[[Any], None]], None]


def remapped(*topics: str) -> list[str]:
    """Return the arguments that let a node publish topics to the relay instead."""
    return ['--ros-args', *(word for topic in topics
                            for word in ('-r', f'{topic}:={RAW}{topic}'))]


def send_on(message: Any, send: Callable[[Any], None]) -> None:
    """Send the message on as it is."""
    send(message)


class Relay(Node):
    """
    Passes topics on from raw/TOPIC to TOPIC.

    Parameters
    ----------
    alter : dict
        By topic, the function that alters its messages; `send_on` where none are altered.

    """

    def __init__(self, alter: dict[str, Alter], **options: Any):
        super().__init__('relay', **options)
        self.alter = alter
        for name in alter:
            topic = load_topics()[name]
            send = create_publisher(self, name).publish
            self.create_subscription(
                interface_class(topic.type), RAW + name, self._passer(name, send),
                qos_profile(topic.qos))

    def _passer(self, name: str, send: Callable[[Any], None]) -> Callable[[Any], None]:
        return lambda message: self.alter[name](message, send)


def at_stamps(spoilers: dict[int, Callable[[Any], None]], done: set[int]) -> Alter:
    """Return an Alter that spoils the first message of each stamp, ns, and adds it to `done`."""
    def alter(message: Any, send: Callable[[Any], None]) -> None:
        stamp = stamp_of(message)
        if stamp in spoilers and stamp not in done:
            done.add(stamp)
            spoilers[stamp](message)
        send(message)
    return alter
