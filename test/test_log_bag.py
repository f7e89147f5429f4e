"""Bags as logs: aligned by stamp, named values, and one line for every way to get them wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import math
from pathlib import Path
from typing import Any

from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.tools.estimate import estimate
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.logs.bag_log import write_bag
from flex_plant_sim.logs.csv_log import write_csv
from flex_plant_sim.logs.log import Log
from flex_plant_sim.logs.origin import Origin
from flex_plant_sim.logs.read import read_log
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import simulate, Simulator
from msg_config.errors import InputError
import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

ROBOT = load_robot('reference')
FAST = replace(ROBOT, sample_time=0.005)
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
    return [('/arm/strain', t + 9, joint_state(t, GAUGES, [k / 1e4, 1e-4, 2e-4, 3e-4]))
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
    np.testing.assert_allclose(log.strain[:, 0], [1e-4, 2e-4, 3e-4, 4e-4])
    np.testing.assert_array_equal(log.command[:, 0], [10, 20, 30, 40])


def test_names_in_a_message_say_which_value_is_whose(tmp_path: Path) -> None:
    turned = [(topic, arrival, joint_state(t, GAUGES[::-1], list(message.position[::-1])))
              for t, (topic, arrival, message) in zip(ticks(4), strains(4))]
    log = read_log(record(tmp_path / 'bag', [*states(4), *turned, *commands(4)]), ROBOT)
    np.testing.assert_array_equal(log.strain[2], [2e-4, 1e-4, 2e-4, 3e-4])


def test_a_late_command_acts_from_its_stamp_on(tmp_path: Path) -> None:
    bag = record(tmp_path / 'bag', [*states(4), *strains(4), *commands(4, late=2_000_000)])
    np.testing.assert_array_equal(read_log(bag, ROBOT).command[:, 0],
                                  [0, 10, 20, 30])


def test_without_commands_the_effort_of_the_next_sample_is_the_command(tmp_path: Path) -> None:
    log = read_log(record(tmp_path / 'bag', [*states(5), *strains(5)]), ROBOT)
    np.testing.assert_array_equal(log.command[:, 0], [0, 10, 20, 30])


def test_velocities_are_not_read(tmp_path: Path) -> None:
    told = states(5)
    for _, _, message in told:
        message.velocity = np.array([math.nan])
    log = read_log(record(tmp_path / 'bag', [*told, *strains(5)]), ROBOT)
    np.testing.assert_allclose(log.joint[:, 0], [0.0, 0.1, 0.2, 0.3])


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


def disturbed(seed: int) -> list[tuple[str, int, Any]]:
    """Return 4 s at 200 Hz as a robot sends them: other names and order, jitter, losses, lag."""
    rng, messages = np.random.default_rng(seed), []
    for k, (output, applied) in enumerate(zip(*moving_arm())):
        tick = START + 5_000_000 * k
        stamps = [tick + int(rng.uniform(-2e5, 2e5)), tick + 300_000 + int(rng.uniform(-2e5, 2e5))]
        parts = [('/r/joint_states', joint_state(stamps[0], ['elbow', 'gripper', 'shoulder'],
                                                 [output[1], 0.3, output[0]],
                                                 [applied[1], 9.0, applied[0]])),
                 ('/r/strain', joint_state(stamps[1], GAUGES[::-1], list(output[:1:-1])))]
        messages += [(topic, stamp, message) for (topic, message), stamp in zip(parts, stamps)
                     if rng.random() > 0.01]
    return messages


def moving_arm() -> tuple[np.ndarray, np.ndarray]:
    """Return measurements and the commands applied before them, with a payload of 0.25 kg."""
    time = 0.005 * np.arange(800.0)
    command = np.stack([np.sign(np.sin(3.0 * time)), np.sin(8.0 * time)], axis=1)
    arm = ExtendedArm(FAST, 'assumed_modes', 2, 0.25)
    output, _ = simulate(Simulator(arm), command)
    std = np.repeat([FAST.angle_noise, FAST.strain_noise], [2, 4])
    noise = std * np.random.default_rng(8).standard_normal(output.shape)
    return output + noise, np.vstack([np.zeros(2), command[:-1]])


def test_a_realistic_bag_tells_the_payload_of_the_ideal_one(tmp_path: Path) -> None:
    """Jitter 200 us, 1 % lost, strain 0.3 ms late, a gripper, other names in another order."""
    output, applied = moving_arm()
    ideal = Log('ideal', 0.005 * np.arange(799.0), applied[1:], output[:-1, :2], output[:-1, 2:],
                FAST.gauge_names)
    found = read_log(record(tmp_path / 'bag', disturbed(3)), FAST)
    assert 'samples lost' in found.notes[0] and 'jitter by up to' in found.notes[1]
    assert not found.doubts and abs(len(found) - 799) <= 3
    answers = [estimate(log, make_estimator('rpe', FAST, 'assumed_modes', 2))
               for log in (ideal, found)]
    mass, std = ([answer.row(-1)[k] for answer in answers] for k in (0, 1))
    assert abs(mass[1] - mass[0]) < std[0]


def test_strain_at_half_rate_or_that_ends_early_is_said_and_doubted(tmp_path: Path) -> None:
    half = read_log(record(tmp_path / 'half', [*states(18), *strains(18)[::2]]), ROBOT)
    assert half.doubts[0] == 'strain comes every 20 ms, joint_states every 10 ms: used one ' \
                             'of 2 of these, commands averaged'
    np.testing.assert_allclose(half.command[:3, 0], [5.0, 25.0, 45.0])
    early = read_log(record(tmp_path / 'early', [*states(20), *strains(12)]), ROBOT)
    assert len(early) == 12 and early.doubts[0] == \
        'joint_states lasts 0.19 s, strain shares 0.11 s of it: used those'


def test_effort_as_applied_is_preferred_and_said(tmp_path: Path) -> None:
    other = [(topic, at, joint_state(at - 30, JOINTS, [], [7.0, 1.0]))
             for topic, at, _ in commands(6)]
    log = read_log(record(tmp_path / 'bag', [*states(6), *strains(6), *other]), ROBOT)
    np.testing.assert_array_equal(log.command[:5, 0], [0, 10, 20, 30, 40])
    assert log.notes[0] == ('commands: as applied (effort of joint_states); in 5 of 5 samples the '
                            'topic command says otherwise')


@pytest.mark.parametrize('filled, words', [
    ([0.0, 0.0], 'zero throughout'), ([math.nan] * 2, 'not always finite'), ([], 'missing')])
def test_effort_that_a_driver_fills_in_is_none(
        tmp_path: Path, filled: list[float], words: str) -> None:
    told = states(6)
    for _, _, message in told:
        message.effort = np.array(filled)
    log = read_log(record(tmp_path / 'bag', [*told, *strains(6), *commands(6)]), ROBOT)
    np.testing.assert_array_equal(log.command[:5, 0], [0, 10, 20, 30, 40])
    assert log.notes[0] == ('commands: as sent on the topic command; effort of joint_states is '
                            + words)
    if words != 'zero throughout':  # which may be so where nothing was sent
        with pytest.raises(InputError, match=f'topic command: missing, and effort of .* {words}'):
            read_log(record(tmp_path / 'alone', [*told, *strains(6)]), ROBOT)


def test_names_are_read_in_every_message(tmp_path: Path) -> None:
    turned = [(topic, at, joint_state(START + 10**7 * k, JOINTS[::-1] if k % 2 else JOINTS,
                                      list(m.position[::-1] if k % 2 else m.position),
                                      list(m.effort[::-1] if k % 2 else m.effort)))
              for k, (topic, at, m) in enumerate(states(5))]
    log = read_log(record(tmp_path / 'bag', [*turned, *strains(5)]), ROBOT)
    np.testing.assert_allclose(log.joint[:, 0], [0.0, 0.1, 0.2, 0.3])
    np.testing.assert_array_equal(log.command[:, 0], [0, 10, 20, 30])


def test_a_bag_that_unpacks_to_too_much_is_refused(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """10 kB of compressed zeros would be 300 MB on disk; 30 MB are allowed here."""
    zstd = pytest.importorskip('backports.zstd')
    monkeypatch.setattr('flex_plant_sim.logs.bounded.FILE', 30_000_000)
    monkeypatch.setenv('TMPDIR', str(tmp_path / 'disk'))
    monkeypatch.setattr('tempfile.tempdir', None)
    (tmp_path / 'disk').mkdir()
    writer = Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.FILE, CompressionFormat.ZSTD)
    with writer:
        known = writer.add_connection('/strain', JOINT_STATE, typestore=TYPES)
        writer.write(known, START, TYPES.serialize_cdr(strains(1)[0][2], JOINT_STATE))
    packed, = (tmp_path / 'bag').glob('*.z*')
    packed.write_bytes(zstd.compress(bytes(10_000_000)) * 30)
    with pytest.raises(InputError, match='expected a rosbag2, got: .*too large'):
        read_log(tmp_path / 'bag', ROBOT)
    assert list((tmp_path / 'disk').iterdir()) == []


def test_a_message_that_is_cut_is_left_out_and_the_others_are_read(tmp_path: Path) -> None:
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        known = {topic: writer.add_connection(topic, JOINT_STATE, typestore=TYPES)
                 for topic in ('/arm/joint_states', '/arm/strain')}
        for k, (topic, arrival, message) in enumerate([*states(20), *strains(20)]):
            data = TYPES.serialize_cdr(message, JOINT_STATE)
            writer.write(known[topic], arrival, data[:40] if k == 9 else data)
    log = read_log(tmp_path / 'bag', ROBOT)
    assert len(log.time) in (19, 20)
    assert any('the bag tells of 20 messages, 19 can be read' in note for note in log.notes)


def test_a_bag_says_what_simulated_it(tmp_path: Path) -> None:
    log = read_log(record(tmp_path / 'bag', [*states(5), *strains(5)]), ROBOT)
    assert log.origin is None
    origin = Origin('reference', 'assumed_modes', 2, coriolis=True)
    write_bag(tmp_path / 'told', replace(log, origin=origin))
    write_csv(tmp_path / 'told.csv', replace(log, origin=origin))
    for name in ('told', 'told.csv'):
        assert read_log(tmp_path / name, ROBOT).origin == origin
    for forces in (True, None):
        assert origin.against('reference', 'assumed_modes', 2, forces) == ''
    assert '--model assumed_modes --modes 2, read with reference, paper, 2: ' \
        in origin.against('reference', 'paper', 2, True)
    assert '--modes 2, with Coriolis forces, read with reference, assumed_modes, 2, without ' \
        'Coriolis forces: ' in origin.against('reference', 'assumed_modes', 2, False)


@pytest.mark.parametrize('shift', [0, -3_000_000, -10**9 * 1000])
def test_only_the_arm_s_own_stamps_must_increase(tmp_path: Path, shift: int) -> None:
    """A gripper shares two topics, with the arm's stamps, an earlier clock, or one that stands."""
    gripper = [(topic, arrival + 1, joint_state(max(t + shift, START - 10**12), ['finger'],
                                                [0.3], [9.0]))
               for (topic, arrival, _), t in zip([*states(20), *commands(20)], 2 * ticks(20))]
    arm = [*states(20), *strains(20), *commands(20)]
    # Lock-step sends a sample again; the gripper speaks in between.
    again = [(topic, arrival + 2, message) for topic, arrival, message in states(20)[7:8]]
    log = read_log(record(tmp_path / 'bag', sorted([*arm, *gripper, *again],
                                                   key=lambda item: item[1])), ROBOT)
    alone = read_log(record(tmp_path / 'alone', arm), ROBOT)
    assert log.notes == alone.notes
    for name in ('time', 'joint', 'strain', 'command'):
        np.testing.assert_array_equal(getattr(log, name), getattr(alone, name))


def test_two_publishers_are_not_a_fast_one(tmp_path: Path) -> None:
    other = [(topic, arrival + 3_000_000, joint_state(t + 3_000_000, JOINTS, [0.0, 0.0]))
             for (topic, arrival, _), t in zip(states(20), ticks(20))]
    both = sorted([*states(20), *other], key=lambda item: item[1])
    with pytest.raises(InputError, match='joint_states: expected one publisher, got messages '
                       '3 and 7 ms apart by turns, as of two'):
        read_log(record(tmp_path / 'bag', [*both, *strains(20)]), ROBOT)


def test_topics_of_two_namespaces_are_said(tmp_path: Path) -> None:
    other = [('/other/strain', arrival, message) for _, arrival, message in strains(20)]
    log = read_log(record(tmp_path / 'bag', [*states(20), *other]), ROBOT)
    assert 'several namespaces are read as of one arm: /arm/joint_states, /other/strain' \
        in log.notes[0]
    one = read_log(record(tmp_path / 'one', [*states(20), *strains(20)]), ROBOT)
    assert not any('namespaces' in note for note in one.notes)


def test_a_recording_that_was_cut_off_is_told_how_it_is_mended(tmp_path: Path) -> None:
    bag = record(tmp_path / 'bag', [*states(20), *strains(20)])
    file, = bag.glob('*.mcap')
    file.write_bytes(file.read_bytes()[:-40])
    with pytest.raises(InputError, match='mended by mcap recover'):
        read_log(bag, ROBOT)


def test_an_arm_without_gauges_needs_no_strain(tmp_path: Path) -> None:
    upper, lower = (replace(link, gauge_positions=()) for link in ROBOT.links)
    bare = replace(ROBOT, links=(upper, lower))
    bag = record(tmp_path / 'bag', [*states(5), *commands(5)])
    log = read_log(bag, bare)
    np.testing.assert_allclose(log.joint[:, 0], [0.1 * k for k in range(5)])
    assert log.strain.shape == (5, 0) and not log.doubts
    with pytest.raises(InputError, match='strain: missing, got'):
        read_log(bag, ROBOT)
