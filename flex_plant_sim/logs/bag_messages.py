"""The messages of a bag that make a log, topic by topic, and their values by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.inputs.stamps import sane_stamp
from flex_plant_sim.logs.bounded import bounded
from msg_config import load_topics
from msg_config.errors import InputError
from msg_config.input_mapping import Channels, InputMapping
import numpy as np
from numpy.typing import NDArray

NANOSECONDS = 1_000_000_000
TOPICS = ('joint_states', 'strain', 'command')
Stamps = NDArray[np.int64]


def seconds_text(stamp: int) -> str:
    """Return a stamp, ns, in s; a double has no room for the digits of today's clock."""
    return f'{stamp // NANOSECONDS}.{stamp % NANOSECONDS:09d} s'


@dataclass(frozen=True)
class Stream:
    """
    The messages of one topic in the order of recording.

    Attributes
    ----------
    path : Path
        Of the bag, for errors.
    name : str
        Of the topic in the contract.
    messages : tuple
        JointStates.
    stamps : array of int
        ns, increasing.

    """

    path: Path
    name: str
    messages: tuple[Any, ...]
    stamps: Stamps

    @classmethod
    def of(cls, path: Path, name: str, messages: Sequence[Any]) -> Stream:
        """
        Return a topic's messages with their stamps.

        Raises
        ------
        InputError
            A stamp is no time, or does not come after the one before.

        """
        for k, message in enumerate(messages):
            own = message.header.stamp
            if not sane_stamp(own.sec, own.nanosec):
                raise InputError(f'{path}: {name}: message {k + 1}: header.stamp: expected a '
                                 f'time, got {own.sec} s and {own.nanosec} ns')
        stamps = np.array([m.header.stamp.sec * NANOSECONDS + m.header.stamp.nanosec
                           for m in messages], dtype=np.int64)
        late = np.diff(stamps) <= 0
        if late.any():
            k = int(np.argmax(late)) + 1
            raise InputError(f'{path}: {name}: message {k + 1}: expected a stamp after '
                             f'{seconds_text(stamps[k - 1])}, got {seconds_text(stamps[k])}')
        return cls(path, name, tuple(messages), stamps)

    def naming(self, channels: Channels) -> Stream:
        """Return the messages that name any of the channels; drivers share joint_states."""
        own = {name for names in channels.sources for name in names}
        told = [bool(own.intersection(message.name)) for message in self.messages]
        if all(told) or not any(told):
            return self
        return Stream(self.path, self.name,
                      tuple(m for m, tells in zip(self.messages, told) if tells),
                      self.stamps[np.array(told)])

    def values(self, channels: Channels, field: str, rate: bool = False) -> Array:
        """
        Return a field of all messages in SI, (N, n); each message's names say whose is what.

        Raises
        ------
        InputError
            Names and values do not match, or a channel is missing or ambiguous.

        """
        rows = np.empty((len(self.messages), len(channels.own)))
        known: dict[tuple[str, ...], list[int]] = {}
        for k, message in enumerate(self.messages):
            given, values = tuple(message.name), getattr(message, field)
            where = f'{self.path}: {self.name}: message {k + 1}'
            if len(values) != len(given):
                raise InputError(f'{where}: {field}: expected {len(given)} values, one for each '
                                 f'name, got {len(values)}')
            if given not in known:
                known[given] = channels.index(given, where)
            rows[k] = values[known[given]]
        return channels.rate(rows) if rate else channels.si(rows)

    def has(self, field: str) -> bool:
        """Return whether every message fills a field."""
        return bool(self.messages) and all(len(getattr(m, field)) for m in self.messages)


def read_messages(path: Path, mapping: InputMapping
                  ) -> tuple[dict[str, Stream], tuple[str, ...]]:
    """
    Return the messages of the topics that make a log, and notes on what could not be read.

    Raises
    ------
    InputError
        No bag, or a topic is missing, twice there, or of another type.

    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import get_typestore, Stores
    except ImportError:
        raise InputError(f'{path}: reading bags needs the package rosbags: '
                         'pip install rosbags') from None
    try:
        types = get_typestore(Stores.ROS2_JAZZY)
        with bounded(), AnyReader([path], default_typestore=types) as reader:
            found, notes = _collected(path, reader, mapping)
    except InputError:
        raise
    except Exception as error:  # noqa: B902  a torn bag raises what its bytes happen to hit
        raise InputError(f'{path}: expected a rosbag2, got: '
                         f'{type(error).__name__}: {error}') from None
    return {name: Stream.of(path, name, messages) for name, messages in found.items()}, notes


def _collected(path: Path, reader: Any, mapping: InputMapping
               ) -> tuple[dict[str, list[Any]], tuple[str, ...]]:
    chosen = {name: _connections(path, reader, name, mapping) for name in TOPICS}
    owner = {id(c): name for name, group in chosen.items() for c in group}
    found: dict[str, list[Any]] = {name: [] for name in TOPICS}
    came = dict.fromkeys(TOPICS, 0)
    before: dict[str, bytes] = {}
    wanted = [c for group in chosen.values() for c in group]
    for connection, _, data in reader.messages(wanted):
        name = owner[id(connection)]
        came[name] += 1
        # In lock-step a sample that nobody answers in time is sent again.
        if before.get(name) != data:
            found[name].append(reader.deserialize(data, connection.msgtype))
        before[name] = data
    notes = []
    for name, group in chosen.items():
        told = sum(c.msgcount for c in group)
        if came[name] != told:
            notes.append(f'{name}: the bag tells of {told} messages, {came[name]} can be read')
    return found, tuple(notes)


def _connections(path: Path, reader: Any, name: str, mapping: InputMapping) -> list[Any]:
    """Return the connections of a topic of the contract, whatever namespace it is in."""
    topic = load_topics()[name]
    own = mapping.topics.get(name, topic.name)
    group = [c for c in reader.connections if f'/{c.topic}'.endswith(f'/{own.lstrip("/")}')]
    names = sorted({c.topic for c in group})
    if len(names) > 1:
        raise InputError(f'{path}: {name}: expected one topic, got {", ".join(names)}; name it '
                         'under inputs: topics: in the robot file')
    for connection in group:
        if connection.msgtype != topic.type:
            raise InputError(f'{path}: {connection.topic}: expected {topic.type}, '
                             f'got {connection.msgtype}')
    if not group and name != 'command':
        have = ', '.join(sorted({c.topic for c in reader.connections})) or 'none'
        raise InputError(f'{path}: topic {own}: missing, got {have}')
    return group
