"""
Reads the messages of a bag that make up a log, topic by topic, and finds their values by name.

`bag_log` pairs them into samples.
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PosixPath
from typing import Any

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.logs.bounded import bounded, MEMORY
from msg_config.contract import load_topics
from msg_config.errors import InputError
from msg_config.input_mapping import Channels, InputMapping
from msg_config.time_stamp import NANOSECONDS, valid_stamp
import numpy as np
from numpy.typing import NDArray

FIELDS = ('position', 'effort')
# Largest number of different lists of names on a topic.
MAX_NAME_LISTS = 100
# What data begins with that Zstandard compressed (RFC 8878, 3.1.1); a message begins with a zero.
ZSTD = b'\x28\xb5\x2f\xfd'
Stamps = NDArray[np.int64]


def seconds_text(stamp: int) -> str:
    """Return a stamp, ns, as text in s; a double cannot hold all digits of today's clock."""
    return f'{stamp // NANOSECONDS}.{stamp % NANOSECONDS:09d} s'


@dataclass(frozen=True)
class Fields:
    """
    One field of all messages of a topic.

    Attributes
    ----------
    flat : Array
        The values of all messages, one message after the other.
    count : array of int
        Number of values of each message, (N,).

    """

    flat: Array
    count: Stamps

    def of(self, rows: Stamps) -> tuple[Array, Stamps]:
        """Return all values, and the index of the first value of each of these messages."""
        begin = np.concatenate([[0], np.cumsum(self.count)])
        return self.flat, begin[rows]


@dataclass(frozen=True)
class Stream:
    """
    The messages of one topic that name any of the arm's channels, in the order of recording.

    Attributes
    ----------
    path : Path
        Path of the bag, for error messages.
    name : str
        Name of the topic in the contract.
    stamps : array of int
        Stamps, ns, increasing, (N,).
    number : array of int
        Number of each message among all on the topic, from 1, (N,).
    names : tuple of tuple of str
        The different lists of names in the messages.
    group : array of int
        Index in `names` of the list of each message, (N,).
    fields : Mapping of str to Fields
        position and effort.

    """

    path: Path
    name: str
    stamps: Stamps
    number: Stamps
    names: tuple[tuple[str, ...], ...]
    group: Stamps
    fields: Mapping[str, Fields]

    def values(self, channels: Channels, field: str) -> Array:
        """
        Return a field of all messages in SI units, (N, n), assigned by each message's names.

        Raises
        ------
        InputError
            Names and values do not match, or a channel is missing or ambiguous.

        """
        found, own = np.empty((len(self.stamps), len(channels.own))), self.fields[field]
        for number, given in enumerate(self.names):
            rows = np.flatnonzero(self.group == number)
            if not rows.size:
                continue
            wrong = own.count[rows] != len(given)
            at = int(rows[int(np.argmax(wrong))])
            where = f'{self.path}: {self.name}: message {self.number[at]}'
            if wrong.any():
                raise InputError(f'{where}: {field}: expected {len(given)} values, one for each '
                                 f'name, got {int(own.count[at])}')
            flat, begin = own.of(rows)
            found[rows] = flat[begin[:, None] + np.array(channels.index(given, where))]
        return channels.si(found)

    def has(self, field: str) -> bool:
        """Return whether every message has values in a field."""
        return len(self.stamps) > 0 and bool(self.fields[field].count.all())


class _Collector:
    """
    Collects what is needed of a topic's messages, with some forty bytes per value.

    Several drivers may share joint_states, each with its own clock. Only the messages that name
    any of the channels are of the arm, and only their stamps must increase.
    """

    def __init__(self, path: Path, name: str, channels: Channels):
        self.path, self.name, self.channels = path, name, channels
        self.seen, self.last = 0, b''
        self.others: tuple[str, ...] | None = None
        self.stamps, self.number, self.group = array('q'), array('q'), array('q')
        self.names: dict[tuple[str, ...], int] = {}
        self.flat = {field: array('d') for field in FIELDS}
        self.count = {field: array('q') for field in FIELDS}

    def add(self, message: Any, data: bytes) -> None:
        """Add a message and its bytes; its stamp must be later than that of the one before."""
        self.seen += 1
        names = tuple(message.name)
        if not self.channels.name_any(names):
            self.others = names if self.others is None else self.others
            return
        # In lock-step a sample that is not answered in time is sent again: equal messages are one.
        if data == self.last:
            return
        self.last = data
        own = message.header.stamp
        where = f'{self.path}: {self.name}: message {self.seen}'
        if not valid_stamp(own.sec, own.nanosec):
            raise InputError(f'{where}: header.stamp: expected a time, got {own.sec} s and '
                             f'{own.nanosec} ns')
        stamp = own.sec * NANOSECONDS + own.nanosec
        if self.stamps and stamp <= self.stamps[-1]:
            # A sample in several messages has one stamp: what each lacks is the cause.
            self.channels.index(names, where)
            raise InputError(f'{where}: expected a stamp after {seconds_text(self.stamps[-1])}, '
                             f'got {seconds_text(stamp)}')
        if len(self.names) > MAX_NAME_LISTS:
            raise InputError(f'{where}: name: expected at most {MAX_NAME_LISTS} different lists')
        self.stamps.append(stamp)
        self.number.append(self.seen)
        self.group.append(self.names.setdefault(names, len(self.names)))
        for field in FIELDS:
            values = getattr(message, field)
            self.flat[field].extend(values)
            self.count[field].append(len(values))

    def stream(self) -> Stream:
        """Return the collected messages; raise InputError where all are of something else."""
        if self.others is not None and not self.stamps:
            self.channels.index(self.others, f'{self.path}: {self.name}: message 1')
        fields = {field: Fields(np.array(self.flat[field]),
                                np.array(self.count[field], dtype=np.int64)) for field in FIELDS}
        stamps, number, group = (np.array(values, dtype=np.int64)
                                 for values in (self.stamps, self.number, self.group))
        return Stream(self.path, self.name, stamps, number, tuple(self.names), group, fields)


class _StoragePath(PosixPath):
    """A path whose suffix is in lower case, by which rosbags tells the storage of a file."""

    @property
    def suffix(self) -> str:
        """Return the suffix in lower case."""
        return super().suffix.lower()


def read_messages(path: Path, mapping: InputMapping, channels: Mapping[str, Channels]
                  ) -> tuple[dict[str, Stream], tuple[str, ...]]:
    """
    Return the messages of the topics that make up a log, and notes on what could not be read.

    `channels` holds what is sought on each topic; all but `command` must be there.

    Raises
    ------
    InputError
        No bag, or a topic is missing, ambiguous, of another type, or of something else.

    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import get_typestore, Stores
    except ImportError:
        raise InputError(f'{path}: reading bags needs the package rosbags: '
                         'pip install rosbags') from None
    try:
        types = get_typestore(Stores.ROS2_JAZZY)
        with bounded(), AnyReader([_StoragePath(path)], default_typestore=types) as reader:
            found, notes = _collected(path, reader, mapping, channels)
    except InputError:
        raise
    except MemoryError:
        raise InputError(f'{path}: expected a bag that takes at most {MEMORY / 1e6:g} MB of '
                         'memory; a long one can be split') from None
    except Exception as error:  # noqa: B902  a damaged bag can raise anything
        # What the recorder writes last is missing where it was killed.
        cut = '; a recording that was cut off is mended by mcap recover' \
            if 'end magic' in str(error) else ''
        raise InputError(f'{path}: expected a rosbag2, got: '
                         f'{type(error).__name__}: {error}{cut}') from None
    return {name: collector.stream() for name, collector in found.items()}, notes


def _collected(path: Path, reader: Any, mapping: InputMapping, channels: Mapping[str, Channels]
               ) -> tuple[dict[str, _Collector], tuple[str, ...]]:
    chosen = {name: _connections(path, reader, name, mapping) for name in channels}
    for name, group in chosen.items():
        if not group and name != 'command':
            have = ', '.join(sorted({c.topic for c in reader.connections})) or 'none'
            raise InputError(f'{path}: topic {_own_topic(name, mapping)}: missing, got {have}')
    owner = {id(c): name for name, group in chosen.items() for c in group}
    found = {name: _Collector(path, name, own) for name, own in channels.items()}
    came = dict.fromkeys(channels, 0)
    wanted = [c for group in chosen.values() for c in group]
    for connection, _, data in reader.messages(wanted):
        name = owner[id(connection)]
        try:
            message = reader.deserialize(data, connection.msgtype)
        except MemoryError:
            raise
        except Exception:  # noqa: B902  a message that was cut can raise anything
            if bytes(data[:len(ZSTD)]) == ZSTD:
                raise InputError(f'{path}: {name}: expected messages as they were sent, got '
                                 'compressed ones, of which metadata.yaml tells how: name the '
                                 "bag's folder") from None
            continue
        found[name].add(message, data)
        came[name] += 1
    notes = []
    for name, group in chosen.items():
        told = sum(c.msgcount for c in group)
        if came[name] != told:
            notes.append(f'{name}: the bag tells of {told} messages, {came[name]} can be read')
    spaces = {name: group[0].topic.rpartition(_own_topic(name, mapping).lstrip('/'))[0]
              for name, group in chosen.items() if group and name not in mapping.topics}
    if len(set(spaces.values())) > 1:
        notes.append('topics of several namespaces are read as of one arm: ' + ', '.join(
            chosen[name][0].topic for name in spaces) + '; name them under inputs: topics: in '
            'the robot file')
    return found, tuple(notes)


def _own_topic(name: str, mapping: InputMapping) -> str:
    """Return the name of a topic of the contract in a bag, without its namespace."""
    return mapping.topics.get(name, load_topics()[name].name)


def _connections(path: Path, reader: Any, name: str, mapping: InputMapping) -> list[Any]:
    """Return the connections of a topic of the contract, in any namespace."""
    topic = load_topics()[name]
    own = _own_topic(name, mapping)
    group = [c for c in reader.connections if f'/{c.topic}'.endswith(f'/{own.lstrip("/")}')]
    names = sorted({c.topic for c in group})
    if len(names) > 1:
        raise InputError(f'{path}: {name}: expected one topic, got {", ".join(names)}; name it '
                         'under inputs: topics: in the robot file')
    for connection in group:
        if connection.msgtype != topic.type:
            raise InputError(f'{path}: {connection.topic}: expected {topic.type}, '
                             f'got {connection.msgtype}')
    return group
