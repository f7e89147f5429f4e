"""Files of bags: suffixes in capitals, packed messages, joints apart, and logs named twice."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from attack.run import good_log, ROBOT
from flex_plant_sim.logs.bag_log import write_bag
from flex_plant_sim.logs.read import read_log
from flex_plant_sim.tools.log_input import read_logs
from msg_config.errors import InputError
import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

TYPES = get_typestore(Stores.ROS2_JAZZY)


@pytest.mark.parametrize('storage, suffix', [('mcap', 'mcap'), ('sqlite3', 'db3')])
def test_a_suffix_in_capitals_is_the_same(
        storage: Literal['mcap', 'sqlite3'], suffix: str, tmp_path: Path) -> None:
    log = good_log(20)
    write_bag(tmp_path / 'bag', log, storage)
    for name in (f'LOG.{suffix.upper()}', f'log.{suffix.capitalize()}'):
        (tmp_path / name).hardlink_to(tmp_path / 'bag' / f'bag.{suffix}')
        np.testing.assert_allclose(read_log(tmp_path / name, ROBOT).joint, log.joint)


@pytest.mark.parametrize('second', ['bag/bag.mcap', 'link.mcap', 'log', '../bag'])
def test_a_log_that_two_names_lead_to_is_read_once(second: str, tmp_path: Path) -> None:
    """Its evidence would count twice."""
    folder = tmp_path / 'here'
    folder.mkdir()
    write_bag(folder / 'bag', good_log(20))
    (tmp_path / 'bag').symlink_to(folder / 'bag')
    (folder / 'log').symlink_to(folder / 'bag')
    (folder / 'link.mcap').hardlink_to(folder / 'bag' / 'bag.mcap')
    names = [str(folder / 'bag'), str(folder / second)]
    with pytest.raises(InputError) as error:
        read_logs(names, ROBOT, 'assumed_modes', 2)
    assert str(error.value) == f'{names[1]}: expected each log once, got what {names[0]} holds'


def test_equal_logs_in_two_files_are_two(tmp_path: Path) -> None:
    for name in ('a', 'b'):
        write_bag(tmp_path / name, good_log(20))
    logs = read_logs([str(tmp_path / name) for name in ('a', 'b')], ROBOT, 'assumed_modes', 2)
    assert len(logs) == 2


@pytest.mark.parametrize('storage', [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_compressed_messages_are_read_by_the_folder_that_tells_of_them(
        storage: StoragePlugin, tmp_path: Path) -> None:
    pytest.importorskip('backports.zstd')
    write_bag(tmp_path / 'plain', good_log(20))
    bag, writer = tmp_path / 'bag', Writer(tmp_path / 'bag', version=9, storage_plugin=storage)
    writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with Reader(tmp_path / 'plain') as reader, writer:
        known = {c.topic: writer.add_connection(c.topic, c.msgtype, typestore=TYPES)
                 for c in reader.connections}
        for connection, stamp, data in reader.messages():
            writer.write(known[connection.topic], stamp, data)
    np.testing.assert_allclose(read_log(bag, ROBOT).joint, good_log(20).joint)
    file, = (item for item in bag.iterdir() if item.name != 'metadata.yaml')
    with pytest.raises(InputError, match=f'{file.name}: joint_states: expected messages as they '
                       "were sent, got compressed ones, .*: name the bag's folder$"):
        read_log(file, ROBOT)


def test_joints_in_messages_of_their_own_are_told_by_what_these_lack(tmp_path: Path) -> None:
    message, header, time = (TYPES.types[name] for name in (
        'sensor_msgs/msg/JointState', 'std_msgs/msg/Header', 'builtin_interfaces/msg/Time'))
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        known = {topic: writer.add_connection(topic, message.__msgtype__, typestore=TYPES)
                 for topic in ('/joint_states', '/strain')}
        for topic, names in [('/joint_states', ['joint_1']), ('/joint_states', ['joint_2']),
                             ('/strain', list(ROBOT.gauge_names))]:
            own = message(header(time(1, 0), ''), names, np.zeros(len(names)), np.zeros(0),
                          np.zeros(0))
            writer.write(known[topic], 10**9, TYPES.serialize_cdr(own, message.__msgtype__))
    with pytest.raises(InputError, match='joint_states: message 2: name: expected joint_1, '
                                         'joint_2; joint_1 is missing from joint_2$'):
        read_log(tmp_path / 'bag', ROBOT)
