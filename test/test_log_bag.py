"""Bags as logs: aligned by stamp, named values, and one line for every way to get them wrong."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.logs.read import read_log
from msg_config.errors import InputError
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

ROBOT = load_robot('reference')
TYPES = get_typestore(Stores.ROS2_JAZZY)
JOINT_STATE = 'sensor_msgs/msg/JointState'


def joint_state(stamp: int, name: list[str], position: list[float] = [],  # noqa: B006
                effort: list[float] = []) -> Any:  # noqa: B006
    header = TYPES.types['std_msgs/msg/Header'](
        TYPES.types['builtin_interfaces/msg/Time'](*divmod(stamp, 10**9)), '')
    return TYPES.types[JOINT_STATE](header, name, np.array(position, dtype=float), np.zeros(0),
                                    np.array(effort, dtype=float))


def record(path: Path, messages: list[tuple[str, int, Any]]) -> Path:
    """Write (topic, time of arrival, message) as MCAP."""
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        known = {topic: writer.add_connection(topic, JOINT_STATE, typestore=TYPES)
                 for topic in sorted({topic for topic, _, _ in messages})}
        for topic, arrival, message in messages:
            writer.write(known[topic], arrival, TYPES.serialize_cdr(message, JOINT_STATE))
    return path


JOINTS = ['joint_1', 'joint_2']
GAUGES = list(ROBOT.gauge_names)
START = 1_700_000_000_123_456_789


def ticks(count: int) -> list[int]:
    return [START + k * 10_000_000 for k in range(count)]


def states(count: int) -> list[tuple[str, int, Any]]:
    """Return angles k / 10, -k / 10, and the effort applied before sample k: 10 (k - 1), 0."""
    return [('/arm/joint_states', t + 5,
             joint_state(t, JOINTS, [k / 10, -k / 10], [10.0 * (k - 1), 0.0]))
            for k, t in enumerate(ticks(count))]


def strains(count: int) -> list[tuple[str, int, Any]]:
    return [('/arm/strain', t + 9, joint_state(t, GAUGES, [k / 1e3, 1e-4, 2e-4, 3e-4]))
            for k, t in enumerate(ticks(count))]


def commands(count: int, late: int = 0) -> list[tuple[str, int, Any]]:
    return [('/arm/command', t + 30, joint_state(t + late, JOINTS, [], [10.0 * k, 1.0]))
            for k, t in enumerate(ticks(count))]


def test_topics_are_aligned_by_stamp_not_by_arrival(tmp_path: Path) -> None:
    """Strain arrives all at the end and out of step; only its stamps tell where it belongs."""
    late = [(topic, arrival + 10**9, message) for topic, arrival, message in strains(6)[1:]]
    bag = record(tmp_path / 'bag', [*states(5), *commands(5), *late])
    log = read_log(bag, ROBOT)
    np.testing.assert_allclose(log.time, [0.0, 0.01, 0.02, 0.03], atol=1e-12)
    np.testing.assert_allclose(log.joint[:, 0], [0.1, 0.2, 0.3, 0.4])
    np.testing.assert_allclose(log.strain[:, 0], [1e-3, 2e-3, 3e-3, 4e-3])
    np.testing.assert_array_equal(log.command[:, 0], [10, 20, 30, 40])


def test_names_in_a_message_say_which_value_is_whose(tmp_path: Path) -> None:
    turned = [(topic, arrival, joint_state(t, GAUGES[::-1], list(message.position[::-1])))
              for t, (topic, arrival, message) in zip(ticks(4), strains(4))]
    log = read_log(record(tmp_path / 'bag', [*states(4), *turned, *commands(4)]), ROBOT)
    np.testing.assert_array_equal(log.strain[2], [2e-3, 1e-4, 2e-4, 3e-4])


def test_a_late_command_acts_from_its_stamp_on(tmp_path: Path) -> None:
    bag = record(tmp_path / 'bag', [*states(4), *strains(4), *commands(4, late=2_000_000)])
    np.testing.assert_array_equal(read_log(bag, ROBOT).command[:, 0],
                                  [0, 10, 20, 30])


def test_without_commands_the_effort_of_the_next_sample_is_the_command(tmp_path: Path) -> None:
    log = read_log(record(tmp_path / 'bag', [*states(5), *strains(5)]), ROBOT)
    np.testing.assert_array_equal(log.command[:, 0], [0, 10, 20, 30])


BAG_FAULTS: list[tuple[Callable[[], list[tuple[str, int, Any]]], str]] = [
    (lambda: states(4), 'topic strain: missing, got /arm/joint_states'),
    (lambda: strains(4), 'topic joint_states: missing, got /arm/strain'),
    (lambda: [*states(6), *strains(6)[:2], *strains(6)[3:]],
     'sample 3, stamp 1700000000.153456789 s: time: expected 0.01 s after the row before, '
     'got 0.02 s'),
    (lambda: [*states(4), *strains(4), (*states(1)[0][:1], START + 10**9, states(1)[0][2])],
     'joint_states: message 5: expected a stamp after 1700000000.153456789 s, '
     'got 1700000000.123456789 s'),
    (lambda: [*states(4), ('/arm/strain', START, joint_state(START, GAUGES[:2], [1.0, 2.0]))],
     'strain: message 1: name: expected strain_1a, strain_1b, strain_2a, strain_2b; strain_2a is '
     'missing from strain_1a, strain_1b'),
    (lambda: [*states(4), ('/arm/strain', START, joint_state(START, list('abcd'), [1.0] * 4))],
     'strain: message 1: name: expected strain_1a, strain_1b, strain_2a, strain_2b; strain_1a is '
     'missing from a, b, c, d'),
    (lambda: [*states(4), *((topic, at, joint_state(at - 9 + 5_000_000, GAUGES, [1e-4] * 4))
                            for topic, at, _ in strains(4))],
     'strain: header.stamp: expected within 4 ms of joint_states, got '),
    (lambda: [*states(4), ('/strain', START, joint_state(START, GAUGES, [1.0] * 4)), *strains(4)],
     'strain: expected one topic, got /arm/strain, /strain'),
    (lambda: [*states(4), *strains(3), ('/arm/strain', START + 10**9, joint_state(
        ticks(4)[3], GAUGES, [1.0, float('nan'), 1.0, 1.0])), *commands(4)],
     'sample 4, stamp 1700000000.153456789 s: strain_1b: expected a finite number, got nan'),
]


@pytest.mark.parametrize('messages, message', BAG_FAULTS)
def test_a_fault_in_a_bag_is_named_in_one_line(
        tmp_path: Path, messages: Callable[[], list[tuple[str, int, Any]]], message: str) -> None:
    bag = record(tmp_path / 'bag', messages())
    with pytest.raises(InputError) as error:
        read_log(bag, ROBOT)
    assert str(error.value).startswith(f'{bag}: {message}')
    assert '\n' not in str(error.value)
