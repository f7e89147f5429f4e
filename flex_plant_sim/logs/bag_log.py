"""Logs as rosbag2 (sqlite3 or MCAP): the topics of the contract, aligned by header stamp."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.atomic_file import whole_file
from flex_plant_sim.logs.log import checked, Log
from msg_config import load_topics
from msg_config.errors import InputError
import numpy as np
from numpy.typing import NDArray

NANOSECONDS = 1_000_000_000
JOINTS = ('joint_1', 'joint_2')
Stamps = NDArray[np.int64]


def read_bag(path: Path, robot: Robot) -> Log:
    """
    Return the record in a bag folder, or in a single .mcap or .db3 file.

    A sample is a stamp that `joint_states` and `strain` share. Its command is the last one of
    `command` stamped no later; a bag without that topic gives it by the next sample's effort,
    which is the command applied before that sample. Time starts at zero.

    Raises
    ------
    InputError
        No bag, missing topic, wrong gauges, not finite, uneven time; with its topic or message.

    """
    topics = _messages(path)
    stamps, angle, rate, effort = _joint_states(path, topics)
    gauge_stamps, strain = _strain(path, topics, robot)
    common, joint_rows, gauge_rows = np.intersect1d(stamps, gauge_stamps, return_indices=True)
    if common.size == 0:
        raise InputError(f'{path}: strain: expected stamps of joint_states, none is shared')
    keep, command = _commands(path, topics, common, effort, joint_rows)
    common, joint_rows, gauge_rows = common[keep], joint_rows[keep], gauge_rows[keep]
    time = (common - common[0]) / NANOSECONDS if common.size else np.zeros(0)
    log = Log(str(path), time, command, angle[joint_rows], strain[gauge_rows],
              robot.gauge_names, None if rate is None else rate[joint_rows])
    return checked(log, lambda k: f'sample {k + 1}, stamp {_seconds(common[k])}')


def _seconds(stamp: int) -> str:
    # A double has no room for the nanoseconds of today's clock.
    return f'{stamp // NANOSECONDS}.{stamp % NANOSECONDS:09d} s'


def _messages(path: Path) -> dict[str, list[Any]]:
    """Return the messages of the three topics that make a log, in the order of recording."""
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import get_typestore, Stores
    except ImportError:
        raise InputError(f'{path}: reading bags needs the package rosbags') from None
    found: dict[str, list[Any]] = {}
    try:
        types = get_typestore(Stores.ROS2_JAZZY)
        with AnyReader([path], default_typestore=types) as reader:
            chosen = {name: _connections(path, reader, name)
                      for name in ('joint_states', 'strain', 'command')}
            owner = {id(c): name for name, group in chosen.items() for c in group}
            found = {name: [] for name, group in chosen.items() if group}
            wanted = [c for group in chosen.values() for c in group]
            before: dict[str, bytes] = {}
            for connection, _, data in reader.messages(wanted) if wanted else ():
                name = owner[id(connection)]
                # In lock-step a sample that nobody answers in time is sent again.
                if before.get(name) != data:
                    found[name].append(reader.deserialize(data, connection.msgtype))
                before[name] = data
    except InputError:
        raise
    except (AnyReaderError, OSError, ValueError, KeyError) as error:
        line = ' '.join(str(error).split())
        raise InputError(f'{path}: expected a rosbag2, got: {line}') from None
    return found


def _connections(path: Path, reader: Any, name: str) -> list[Any]:
    """Return the connections of a topic of the contract, whatever namespace it is in."""
    topic = load_topics()[name]
    group = [c for c in reader.connections if f'/{c.topic}'.endswith(f'/{topic.name}')]
    names = sorted({c.topic for c in group})
    if len(names) > 1:
        raise InputError(f'{path}: {name}: expected one topic, got {", ".join(names)}')
    for connection in group:
        if connection.msgtype != topic.type:
            raise InputError(f'{path}: {connection.topic}: expected {topic.type}, '
                             f'got {connection.msgtype}')
    if not group and name != 'command':
        have = ', '.join(sorted({c.topic for c in reader.connections})) or 'none'
        raise InputError(f'{path}: topic {name}: missing, got {have}')
    return group


def _stamps(path: Path, topic: str, messages: list[Any]) -> Stamps:
    stamps = np.array([m.header.stamp.sec * NANOSECONDS + m.header.stamp.nanosec
                       for m in messages], dtype=np.int64)
    late = np.diff(stamps) <= 0
    if late.any():
        k = int(np.argmax(late)) + 1
        raise InputError(f'{path}: {topic}: message {k + 1}: expected a stamp after '
                         f'{_seconds(stamps[k - 1])}, got {_seconds(stamps[k])}')
    return stamps


def _field(path: Path, topic: str, messages: list[Any], field: str,
           names: tuple[str, ...]) -> Array:
    """Return a field of all messages, (N, len(names)), in the order of names if they bear them."""
    rows = [np.asarray(getattr(message, field), dtype=float) for message in messages]
    for k, row in enumerate(rows):
        if row.size != len(names):
            raise InputError(f'{path}: {topic}: message {k + 1}: {field}: expected {len(names)} '
                             f'values ({", ".join(names)}), got {row.size}')
    values = np.array(rows).reshape(len(rows), len(names))
    given = list(messages[0].name) if messages else []
    if set(given) == set(names):
        return values[:, [given.index(name) for name in names]]
    return values


def _joint_states(path: Path, topics: dict[str, list[Any]]) -> tuple[
        Stamps, Array, Array | None, Array | None]:
    messages = topics['joint_states']
    if not messages:
        raise InputError(f'{path}: joint_states: expected at least 2 messages, got 0')
    first = messages[0]
    rate = _field(path, 'joint_states', messages, 'velocity', JOINTS) \
        if len(first.velocity) else None
    effort = _field(path, 'joint_states', messages, 'effort', JOINTS) \
        if len(first.effort) else None
    return (_stamps(path, 'joint_states', messages),
            _field(path, 'joint_states', messages, 'position', JOINTS), rate, effort)


def _strain(path: Path, topics: dict[str, list[Any]], robot: Robot) -> tuple[Stamps, Array]:
    messages = topics['strain']
    if not messages:
        raise InputError(f'{path}: strain: expected at least 2 messages, got 0')
    given = tuple(messages[0].name)
    if len(given) == len(robot.gauge_names) and set(given) != set(robot.gauge_names):
        raise InputError(f'{path}: strain: expected gauges {", ".join(robot.gauge_names)}, '
                         f'got {", ".join(given)}')
    return (_stamps(path, 'strain', messages),
            _field(path, 'strain', messages, 'position', robot.gauge_names))


def _commands(path: Path, topics: dict[str, list[Any]], stamps: Stamps, effort: Array | None,
              rows: NDArray[np.intp]) -> tuple[slice, Array]:
    """Return which samples have a command, and the commands of those."""
    if topics.get('command'):
        given = _stamps(path, 'command', topics['command'])
        values = _field(path, 'command', topics['command'], 'effort', JOINTS)
        last = np.searchsorted(given, stamps, side='right') - 1
        first = int(np.searchsorted(last, 0))
        return slice(first, None), values[last[first:]]
    if effort is None:
        raise InputError(f'{path}: topic command: missing, and joint_states has no effort')
    return slice(0, len(rows) - 1), effort[rows[1:]]


def write_bag(path: str | Path, log: Log, storage: Literal['mcap', 'sqlite3'] = 'mcap') -> None:
    """
    Write a log as a bag folder with the contract's topics, whole or not at all.

    Raises
    ------
    InputError
        If nothing can be written there.

    """
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import get_typestore, Stores
    except ImportError:
        raise InputError(f'{path}: writing bags needs the package rosbags') from None
    types = get_typestore(Stores.ROS2_JAZZY)
    plugin = StoragePlugin.MCAP if storage == 'mcap' else StoragePlugin.SQLITE3
    with whole_file(path) as temporary, Writer(temporary, version=9,
                                               storage_plugin=plugin) as writer:
        connections = {
            name: writer.add_connection(f'/{load_topics()[name].name}', load_topics()[name].type,
                                        typestore=types)
            for name in ('joint_states', 'strain', 'command')}
        for name, stamp, message in _samples(log, types):
            data = types.serialize_cdr(message, load_topics()[name].type)
            writer.write(connections[name], stamp, data)


def _samples(log: Log, types: Any) -> Iterator[tuple[str, int, Any]]:
    """Yield topic, stamp (ns) and message; effort is the command applied before the sample."""
    def message(stamp: int, names: tuple[str, ...], position: Array, velocity: Array,
                effort: Array) -> Any:
        time = types.types['builtin_interfaces/msg/Time'](*divmod(stamp, NANOSECONDS))
        header = types.types['std_msgs/msg/Header'](time, '')
        state = types.types['sensor_msgs/msg/JointState']
        return state(header, list(names), *(np.ascontiguousarray(a, dtype=float)
                                            for a in (position, velocity, effort)))

    empty, applied = np.zeros(0), np.zeros(2)
    for k, time in enumerate(log.time):
        stamp = round(float(time) * NANOSECONDS)
        rate = empty if log.velocity is None else log.velocity[k]
        yield 'joint_states', stamp, message(stamp, JOINTS, log.joint[k], rate, applied)
        yield 'strain', stamp, message(stamp, log.gauge_names, log.strain[k], empty, empty)
        yield 'command', stamp, message(stamp, JOINTS, empty, empty, log.command[k])
        applied = log.command[k]
