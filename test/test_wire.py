"""Messages read and written as bytes are what rclpy's own serialisation makes of them."""

from __future__ import annotations

import random
from struct import pack
from types import SimpleNamespace
from typing import Any

from geometry_msgs.msg import InertiaStamped
from msg_config.contract import load_topics
from msg_config.errors import InputError
from msg_config.ros import interface_class, payload_message
from msg_config.wire import MessageReader, MessageWriter
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

NAMES = ('', 'a', 'joint_1', 'strain_1a', 'ünï', 'x' * 300)
NUMBERS = (0.0, -0.0, 5e-324, -1.7e308, 0.25, float('inf'))


def joint_state(chance: random.Random) -> JointState:
    """Return a message of any lengths and names."""
    message = JointState(name=[chance.choice(NAMES) for _ in range(chance.randrange(5))])
    for field in ('position', 'velocity', 'effort'):
        setattr(message, field, [0.0] * chance.randrange(5))
    message.header.frame_id = chance.choice(NAMES)
    return message


def inertia(chance: random.Random) -> InertiaStamped:
    """Return a message of any frame."""
    return InertiaStamped(header=Header(frame_id=chance.choice(NAMES)))


def same(found: Any, message: Any) -> bool:
    """Return whether a message and those in it have the same fields."""
    if not isinstance(found, SimpleNamespace):
        return bool(found == message)
    return all(same(getattr(found, name), getattr(message, name))
               for name in message.get_fields_and_field_types())


def renumber(message: Any, chance: random.Random) -> None:
    """Give a message other numbers."""
    message.header.stamp.sec = chance.randrange(-2**31, 2**31)
    message.header.stamp.nanosec = chance.randrange(2**32)
    if isinstance(message, JointState):
        for field in ('position', 'velocity', 'effort'):
            count = len(getattr(message, field))
            setattr(message, field, [chance.choice(NUMBERS) for _ in range(count)])
        return
    for field in ('m', 'ixx', 'iyz'):
        setattr(message.inertia, field, chance.choice(NUMBERS))
    message.inertia.com.z = chance.choice(NUMBERS)


@pytest.mark.parametrize('make', [joint_state, inertia])
def test_what_is_read_is_what_rclpy_reads(make: Any) -> None:
    chance = random.Random(5)
    known = 0
    for _ in range(60):
        message = make(chance)
        read = MessageReader(type(message), 'topic')
        for _ in range(4):
            renumber(message, chance)
            data = bytearray(serialize_message(message))
            last, found = read._message if read._size > 0 else None, read(bytes(data))
            assert same(found, message)
            assert message == deserialize_message(bytes(data), type(message))
            known += found is last
    # All but the first of each are read without rclpy.
    assert known == 3 * 60


def test_other_names_lengths_or_frames_are_noticed() -> None:
    chance = random.Random(6)
    read = MessageReader(JointState, 'topic')
    for _ in range(300):
        message = joint_state(chance)
        renumber(message, chance)
        assert same(read(serialize_message(message)), message)
    one = JointState(name=['a', 'b'], position=[1.0, 2.0])
    for other in (JointState(name=['a', 'c'], position=[1.0, 2.0]),
                  JointState(name=['a', 'b'], velocity=[1.0, 2.0]),
                  JointState(header=Header(frame_id='m'), name=['a', 'b'], position=[1.0, 2.0])):
        read(serialize_message(one))
        assert same(read(serialize_message(other)), other)


def test_the_other_byte_order_and_what_stands_in_gaps() -> None:
    """Padding is whatever the sender's memory held."""
    message = JointState(name=['a', 'b'], position=[1.0, 2.0])
    read, data = MessageReader(JointState, 'topic'), bytearray(serialize_message(message))
    read(bytes(data))
    # 'a' with its zero fills two of four bytes.
    start = data.index(b'a\0')
    data[start + 2:start + 4] = b'?!'
    assert read(bytes(data)) is read._message
    assert same(read._message, message)
    big = b'\0\0\0\0' + pack('>iI', 7, 8) + pack('>I4x', 1) + pack('>I', 0) \
        + pack('>I', 1) + pack('>d', 0.5) + pack('>II', 0, 0)
    found = read(big)
    assert (found.header.stamp.sec, found.header.stamp.nanosec) == (7, 8)
    assert list(found.position) == [0.5]


@pytest.mark.parametrize('data', [b'', b'\0\1\0\0', b'\0\1\0\0' + b'\xff' * 60])
def test_bytes_that_are_no_message_are_refused(data: bytes) -> None:
    with pytest.raises(InputError, match=f'strain: expected a JointState, got {len(data)} bytes'):
        MessageReader(JointState, 'strain')(data)


def test_what_is_written_is_what_rclpy_writes() -> None:
    chance = random.Random(7)
    for _ in range(60):
        message = joint_state(chance)
        write = MessageWriter(message, 'header', 'velocity', 'effort')
        renumber(message, chance)
        message.position = [0.0] * len(message.position)
        stamp = message.header.stamp
        assert deserialize_message(write(stamp.sec, stamp.nanosec, *message.velocity,
                                         *message.effort), JointState) == message
    write = MessageWriter(payload_message(0.0, 0.0, 0.0), 'data')
    assert deserialize_message(write(0.1, 4e-6, 2.0), type(payload_message(0.0, 0.0, 0.0))) == \
        payload_message(0.1, 4e-6, 2.0)


def test_every_topic_of_one_publisher_can_be_read() -> None:
    for name, topic in load_topics().items():
        if topic.exclusive:
            kind = interface_class(topic.type)
            read = MessageReader(kind, name)
            for _ in range(2):
                assert same(read(serialize_message(kind())), kind())
