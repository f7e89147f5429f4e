"""
Nodes on the loop's topics that compute nothing: what rclpy and DDS alone take of the processor.

`python -m faults.bare_nodes plant_sim --rate 1000` sends or answers the messages of that node.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from struct import Struct
from typing import Any

from msg_config.input_mapping import JOINTS
from msg_config.messages import inertia_message, joint_state
from msg_config.node_process import make_executor, spin
from msg_config.ros import create_publisher, create_sourced_subscription, payload_message
from msg_config.time_stamp import NANOSECONDS
from msg_config.transport import avoid_shared_memory
from msg_config.wire import HEAD
import rclpy
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rclpy.task import Future

GAUGES = ('strain_1a', 'strain_1b', 'strain_2a', 'strain_2b')
TWO = (0.0, 0.0)
# Place of the stamp in the bytes of a message with a header, and the topics without one.
STAMP, UNSTAMPED = slice(HEAD, HEAD + 8), ('payload',)
# By node: the topics that it hears, the last of which it answers, and those that it publishes.
ROLES = {
    'plant_sim': (('command',), ('joint_states', 'strain')),
    'payload_estimator': (('joint_states', 'command', 'strain'), ('payload', 'payload/inertia')),
    'lqg_controller': (('joint_states', 'strain', 'payload/inertia'), ('command',))}


def message(topic: str, stamp: int) -> Any:
    """Return a message of the same length as in the loop."""
    if topic == 'payload':
        return payload_message(0.0, 0.0, 0.0)
    if topic == 'payload/inertia':
        return inertia_message(stamp, 0.0)
    if topic == 'strain':
        return joint_state(stamp, GAUGES, (0.0,) * len(GAUGES))
    if topic == 'command':
        return joint_state(stamp, JOINTS, effort=TWO)
    return joint_state(stamp, JOINTS, TWO, TWO, TWO)


def speaker(node: Node, topics: Sequence[str]) -> Callable[[bytes], None]:
    """Return a function that sends the same message on each topic, with a new stamp."""
    told = [(create_publisher(node, topic), serialize_message(message(topic, 0)),
             topic not in UNSTAMPED) for topic in topics]

    def speak(stamp: bytes) -> None:
        for publisher, data, stamped in told:
            publisher.publish(data[:HEAD] + stamp + data[STAMP.stop:] if stamped else data)
    return speak


def stamps(rate: float) -> Iterator[bytes]:
    """Return a stamp for each sample, as a message carries it."""
    for k in count():
        yield Struct('=iI').pack(*divmod(round(k * NANOSECONDS / rate), NANOSECONDS))


def main() -> None:
    """Run one node until it is killed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('role', choices=ROLES)
    parser.add_argument('--rate', type=float, required=True, help='Hz')
    options = parser.parse_args()
    avoid_shared_memory()
    rclpy.init()
    node, executor = Node(options.role), make_executor()
    heard, said = ROLES[options.role]
    speak = speaker(node, said)
    for topic in heard:
        answers = topic == heard[-1] and options.role != 'plant_sim'
        create_sourced_subscription(
            node, topic, (lambda data, *_: speak(data[STAMP])) if answers else lambda *_: None,
            raw=True)
    if options.role == 'plant_sim':
        due = stamps(options.rate)
        node.create_timer(1.0 / options.rate, lambda: speak(next(due)))
    executor.add_node(node)
    spin(executor, Future())


if __name__ == '__main__':
    main()
