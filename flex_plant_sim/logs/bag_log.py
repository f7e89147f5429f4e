"""
Reads and writes logs as rosbag2 (sqlite3 or MCAP).

The topics of the contract are paired by header stamp into rows, which `rows` turns into a log.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.atomic_file import whole_file
from flex_plant_sim.inputs.resample import KEPT
from flex_plant_sim.inputs.synchroniser import slop_of, Synchroniser
from flex_plant_sim.logs.bag_messages import read_messages, seconds_text, Stream
from flex_plant_sim.logs.commands import Commands
from flex_plant_sim.logs.log import Log
from flex_plant_sim.logs.origin import BAG_KEY, bag_origin, bag_text
from flex_plant_sim.logs.rows import Rows, to_log
from msg_config.contract import load_topics
from msg_config.errors import InputError
from msg_config.input_mapping import CONTRACT, InputMapping
from msg_config.time_stamp import NANOSECONDS
import numpy as np

# Ratio of sampling intervals from which the slower of joints and strain is reported to set the
# sampling.
SLOWER = 1.5
# Share of the mean interval by which neighbouring ones differ where two publishers speak by turns,
# and of that difference by which every second one may.
ALTERNATES = 0.25


def read_bag(path: Path, robot: Robot) -> Log:
    """
    Return the record in a bag folder, or in a single .mcap or .db3 file.

    A sample is a pair of `joint_states` and `strain` whose stamps are close; the names in each
    message assign its values to channels. The command of a sample is the effort that the next
    `joint_states` reports as applied, or else the last `command` stamped before the middle of the
    sample. Time starts at zero.

    Raises
    ------
    InputError
        No bag, a missing topic, wrong gauges or joints, or uneven time; names topic or message.

    """
    gauged = bool(robot.gauge_names)
    angles, gauges = robot.inputs.joint_channels(), robot.inputs.gauge_channels(robot.gauge_names)
    streams, notes = read_messages(path, robot.inputs, {
        'joint_states': angles, **({'strain': gauges} if gauged else {}),
        'command': robot.inputs.command_channels()})
    joints = streams['joint_states']
    # Without gauges each sample is its joint states alone, paired with themselves.
    strain = streams['strain'] if gauged else joints
    angle = joints.values(angles, 'position')
    surface = strain.values(gauges, 'position') if gauged else np.empty((len(angle), 0))
    pairs = _pairs(path, joints, strain)
    commands = Commands.of(streams, robot.inputs)
    j, g = pairs.T
    start = joints.stamps[j[0]]
    time = (joints.stamps[j] - start) / NANOSECONDS
    rows = Rows(str(path), time, angle[j], surface[g],
                commands.around(joints.stamps[j]),
                lambda k: f'sample {k + 1}, stamp {seconds_text(joints.stamps[j[k]])}',
                (*notes, *commands.notes), notes)
    rows = _with_rate_notes(rows, joints, strain, pairs)
    log = to_log(rows, robot, lambda grid: commands.on(grid, int(start)))
    known = np.flatnonzero(np.isfinite(log.command).all(axis=1))
    if known.size < 2:
        why = commands.unused or 'effort of joint_states covers less than two samples'
        raise InputError(f'{path}: topic command: missing, and {why}')
    log = log.part(int(known[0]), int(known[-1]) + 1)
    return replace(log, time=log.time - log.time[0], origin=bag_origin(path))


def _pairs(path: Path, joints: Stream, strain: Stream) -> np.ndarray:
    """Return the message numbers of joint states and strain of each sample, (N, 2)."""
    for stream in (joints, strain):
        if len(stream.stamps) < 2:
            raise InputError(f'{path}: {stream.name}: expected at least 2 messages, '
                             f'got {len(stream.stamps)}')
    interval = min(float(np.median(np.diff(stream.stamps))) for stream in (joints, strain))
    pairing = Synchroniser(('joint_states', 'strain'), slop_of(interval / NANOSECONDS))
    events = sorted([*((int(t), 'joint_states', k) for k, t in enumerate(joints.stamps)),
                     *((int(t), 'strain', k) for k, t in enumerate(strain.stamps))])
    found = [pairing.add(part, stamp, k) for stamp, part, k in events]
    pairs = [(s.parts['joint_states'], s.parts['strain']) for s in found if s is not None]
    if len(pairs) < 2:
        raise InputError(f'{path}: {pairing.why_nothing()}')
    return np.array(pairs)


def _with_rate_notes(rows: Rows, joints: Stream, strain: Stream, pairs: np.ndarray) -> Rows:
    """Return the rows with a note if one topic is slower or shorter than the other."""
    paired = np.diff(joints.stamps[pairs[:, 0]])
    for stream in (joints, strain):
        own = float(np.median(np.diff(stream.stamps)))
        usual = float(np.median(paired))
        if usual > SLOWER * own:
            _check_one_publisher(rows.source, stream)
            slower = 'strain' if stream is joints else 'joint_states'
            rows = rows.noted(f'{slower} comes every {usual * 1e-6:.4g} ms, {stream.name} every '
                              f'{own * 1e-6:.4g} ms: used one of {usual / own:.0f} of these, '
                              'commands averaged', doubtful=True)
        span = float(stream.stamps[-1] - stream.stamps[0])
        shared = float(joints.stamps[pairs[-1, 0]] - joints.stamps[pairs[0, 0]])
        if shared < KEPT * span:
            other = 'strain' if stream is joints else 'joint_states'
            rows = rows.noted(f'{stream.name} lasts {span * 1e-9:.4g} s, {other} shares '
                              f'{shared * 1e-9:.4g} s of it: used those', doubtful=True)
    return rows


def _check_one_publisher(path: str, stream: Stream) -> None:
    """
    Check that a topic is fast, not two interleaved ones of another phase each.

    Every second of their intervals is the same, and neighbours differ; of jitter alone all do.
    """
    interval = np.diff(stream.stamps).astype(float)
    turns, again = (float(np.median(np.abs(interval[k:] - interval[:-k]))) for k in (1, 2))
    if turns > ALTERNATES * np.mean(interval) and again < ALTERNATES * turns:
        found = sorted(float(np.median(interval[k::2])) * 1e-6 for k in (0, 1))
        raise InputError(f'{path}: {stream.name}: expected one publisher, got messages '
                         f'{found[0]:.4g} and {found[1]:.4g} ms apart by turns, as of two')


def write_bag(path: str | Path, log: Log, storage: Literal['mcap', 'sqlite3'] = 'mcap',
              inputs: InputMapping = CONTRACT) -> None:
    """
    Write a log as a bag folder, whole or not at all.

    Parameters
    ----------
    path : str or Path
        The folder.
    log : Log
        In SI units.
    storage : str
        mcap or sqlite3.
    inputs : InputMapping
        Topics, names and units of the arm's robot file, so that the bag can be read with that
        file; by default those of the contract.

    Raises
    ------
    InputError
        Nothing can be written there.

    """
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import get_typestore, Stores
    except ImportError:
        raise InputError(f'{path}: writing bags needs the package rosbags: '
                         'pip install rosbags') from None
    types = get_typestore(Stores.ROS2_JAZZY)
    plugin = StoragePlugin.MCAP if storage == 'mcap' else StoragePlugin.SQLITE3
    with whole_file(path) as temporary, Writer(temporary, version=9,
                                               storage_plugin=plugin) as writer:
        if log.origin is not None:
            writer.set_custom_data(BAG_KEY, bag_text(log.origin))
        connections = {
            name: writer.add_connection(inputs.topics.get(name, f'/{load_topics()[name].name}'),
                                        load_topics()[name].type, typestore=types)
            for name in ('joint_states', 'strain', 'command')}
        for name, stamp, message in _samples(log, types, inputs):
            data = types.serialize_cdr(message, load_topics()[name].type)
            writer.write(connections[name], stamp, data)


def _samples(log: Log, types: Any, inputs: InputMapping) -> Iterator[tuple[str, int, Any]]:
    """Yield topic, stamp (ns) and message; effort is the command applied before the sample."""
    joints, drives = inputs.joint_channels(), inputs.command_channels()
    gauges = inputs.gauge_channels(log.gauge_names)

    def message(stamp: int, names: tuple[str, ...], position: Array, effort: Array) -> Any:
        time = types.types['builtin_interfaces/msg/Time'](*divmod(stamp, NANOSECONDS))
        header = types.types['std_msgs/msg/Header'](time, '')
        state = types.types['sensor_msgs/msg/JointState']
        return state(header, list(names), *(np.ascontiguousarray(a, dtype=float)
                                            for a in (position, empty, effort)))

    commands = drives.outside(log.command)
    empty, applied = np.zeros(0), drives.outside(np.zeros(2))
    for k, time in enumerate(log.time):
        stamp = round(float(time) * NANOSECONDS)
        yield 'joint_states', stamp, message(stamp, joints.names, joints.outside(log.joint[k]),
                                             applied)
        yield 'strain', stamp, message(stamp, gauges.names, gauges.outside(log.strain[k]), empty)
        yield 'command', stamp, message(stamp, drives.names, empty, commands[k])
        applied = commands[k]
