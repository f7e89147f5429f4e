"""What comes in: mapped by name, paired by stamp, put on an even grid, and gated."""

from __future__ import annotations

from dataclasses import replace
import math

from flex_plant_sim.arm.robot_file import load_robot, parse_robot, robot_text
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.inputs.gate import angle_ranges, Gate, judge_record, Limits
from flex_plant_sim.inputs.jitter import deviations, stamp_share
from flex_plant_sim.inputs.resample import (
    even_grid,
    fill_by_hold,
    fill_by_line,
    fill_by_spline,
)
from flex_plant_sim.inputs.stamps import Order, StampOrder
from flex_plant_sim.inputs.synchroniser import slop_of, Synchroniser
from msg_config.errors import InputError
from msg_config.input_mapping import InputMapping
from msg_config.time_stamp import valid_stamp
import numpy as np
import pytest

REFERENCE, QUANSER = load_robot('reference'), load_robot('quanser_2dsfl')
MS = 1_000_000
INPUTS = """
inputs:
  joints:
    joint_1: {name: base, unit: deg, sign: -1, offset: 0.5}
    joint_2: tip_motor
  commands: {joint_1: {name: amps, scale: 2e0}}
  gauges: {strain_1a: {name: sg7, unit: ustrain}}
  topics: {strain: /daq/strain}
  time: {name: t, unit: ms}
"""


def mapped(section: str) -> InputMapping:
    return parse_robot(robot_text('reference') + section, 'arm.yaml').inputs


def test_values_are_taken_by_name_and_become_si() -> None:
    joints = mapped(INPUTS).joint_channels()
    found = joints.pick(['gripper', 'tip_motor', 'base'], [9.0, 0.25, 90.0], 'joint_states')
    assert found == pytest.approx([0.5 - math.pi / 2.0, 0.25])
    strain = mapped(INPUTS).gauge_channels(REFERENCE.gauge_names).pick(
        ['strain_2b', 'strain_2a', 'strain_1b', 'sg7'], [4.0, 3.0, 2.0, 100.0], 'strain')
    assert strain == pytest.approx([1e-4, 2.0, 3.0, 4.0])
    command = mapped(INPUTS).command_channels()
    assert command.pick(['tip_motor', 'base'], [3.0, 5.0], 'command') == pytest.approx([10.0, 3.0])
    assert command.pick(['tip_motor', 'amps'], [3.0, 5.0], 'command') == pytest.approx([10.0, 3.0])
    assert joints.rate(np.array([90.0, 1.0])) == pytest.approx([-math.pi / 2.0, 1.0])


def test_a_command_that_is_only_scaled_keeps_its_column() -> None:
    """In messages its name is that of the joint, whose angle has that column."""
    columns = mapped('inputs: {commands: {joint_1: {scale: 2}, joint_2: u_2}}').columns(('g',))
    assert [*columns.values()] == ['time', 'command_1', 'u_2', 'joint_1', 'joint_2', 'g']


def test_joints_may_bear_the_names_of_their_drives() -> None:
    joints = InputMapping().joint_channels()
    assert joints.pick(['elbow', 'shoulder'], [1.0, 2.0], '') == pytest.approx([2.0, 1.0])


@pytest.mark.parametrize('given, values, message', [
    ([], [1.0, 2.0], 'expected 0 values, one for each name, got 2'),
    (['', ''], [1.0, 2.0], "expected joint_1, joint_2; joint_1 is missing from '', ''"),
    (['joint_1', 'b'], [1.0, 2.0], 'joint_2 is missing from joint_1, b'),
    (['joint_1', 'joint_1'], [1.0, 2.0], 'expected joint_1 once, got joint_1, joint_1'),
    (['joint_1', 'shoulder', 'joint_2'], [1.0, 2.0, 3.0], 'expected joint_1 once'),
])
def test_names_that_do_not_say_which_are_refused(given: list[str], values: list[float],
                                                 message: str) -> None:
    with pytest.raises(InputError) as error:
        InputMapping().joint_channels().pick(given, values, 'joint_states: position')
    assert message in str(error.value)


@pytest.mark.parametrize('section, message', [
    ('inputs: {joints: {joint_3: x}}', 'inputs.joints.joint_3: unknown key'),
    ('inputs: {joints: {joint_1: joint_2}}', "expected each name once, got 'joint_2' "
     'for joints.joint_1 and joints.joint_2'),
    ('inputs: {time: {name: joint_1}}', "arm.yaml: inputs: expected each name once, got 'joint_1' "
     'for time and joints.joint_1'),
    ('inputs: {joints: {joint_1: strain_1a}}', "got 'strain_1a' for joints.joint_1 and "
     'gauges.strain_1a'),
    ('inputs: {commands: {joint_2: joint_1}}', "got 'joint_1' for commands.joint_2 and "
     'joints.joint_1'),
    ('inputs: {joints: {joint_1: {unit: degrees}}}', 'expected rad, deg, got'),
    ('inputs: {gauges: {strain_1a: {sign: 2}}}', 'inputs.gauges.strain_1a.sign: expected 1, -1'),
    ('inputs: {joints: {joint_1: {scale: 1e300}}}', 'joint_1.scale: expected 1e-14 to 1e+06, got '
     '1e+300'),
    ('inputs: {gauges: {strain_1a: {unit: um/m, scale: 1e-9}}}', 'scale: expected 1e-08 to 1e+12'),
    ('inputs: {time: {unit: ns, scale: 1e16}}', 'inputs.time.scale: expected 1e-05 to 1e+15, got'),
    ('inputs: {joints: {joint_1: {offset: 1e10}}}', 'expected -4503.6 to 4503.6, got 1e+10'),
    ('inputs: {gauges: {strain_1a: {offset: -50}}}', 'expected -45.036 to 45.036, got -50'),
    ('inputs: {commands: {joint_2: {offset: 2e6}}}', 'expected -1e+06 to 1e+06, got 2e+06'),
    ('inputs: {time: {unit: min}}', 'inputs.time.unit: expected s, ms, us, ns'),
])
def test_a_fault_in_the_mapping_is_named(section: str, message: str) -> None:
    with pytest.raises(InputError) as error:
        mapped(section)
    assert message in str(error.value)


def disturbed(samples: int, seed: int) -> list[tuple[str, int, int]]:
    """Return (part, stamp, number) at 200 Hz: 200 us jitter, 1 % lost, strain 0.3 ms late."""
    rng = np.random.default_rng(seed)
    messages = []
    for k in range(samples):
        for part, late in (('joint_states', 0), ('strain', 300_000)):
            if rng.random() > 0.01:
                stamp = 5 * MS * (k + 1) + late + int(rng.uniform(-1.0, 1.0) * 200_000)
                messages.append((part, stamp, k))
    return messages


@pytest.mark.parametrize('seed', range(5))
def test_only_parts_of_one_sample_are_paired(seed: int) -> None:
    messages = disturbed(2000, seed)
    kept = {part: {k for name, _, k in messages if name == part}
            for part in ('joint_states', 'strain')}
    pairing = Synchroniser(('joint_states', 'strain'), slop_of(0.005))
    found = [pairing.add(*message) for message in messages]
    whole = [sample.parts for sample in found if sample is not None]
    assert all(parts['joint_states'] == parts['strain'] for parts in whole)
    assert {parts['strain'] for parts in whole} == kept['joint_states'] & kept['strain']


def test_it_says_why_nothing_pairs() -> None:
    pairing = Synchroniser(('joint_states', 'strain'), slop_of(0.01))
    assert pairing.why_nothing() == ''
    for k in range(30):
        assert pairing.add('joint_states', 10 * MS * k, k) is None
    assert pairing.why_nothing() == 'strain: no message, while joint_states comes'
    for k in range(30, 60):
        pairing.add('joint_states', 10 * MS * k, k)
        assert pairing.add('strain', 10 * MS * k + 5 * MS, k) is None
    assert pairing.why_nothing() == \
        'strain: header.stamp: expected within 4 ms of joint_states, got +5 ms'
    assert len(pairing._waiting['strain'].queue) <= 10  # memory stays bounded


def test_it_says_no_offset_where_none_was_seen() -> None:
    pairing = Synchroniser(('joint_states', 'strain'), slop_of(0.01))
    pairing.add('strain', 0, 0)
    pairing.add('joint_states', 5 * MS, 0)
    assert pairing.why_nothing() == 'joint_states, strain: no stamps that belong together'


def test_a_stamp_far_ahead_needs_a_second_one() -> None:
    order = StampOrder(10)
    stamps = [0, 10, 10, 5, 20, 20 + 10**12, 30, 2 * 10**12, 2 * 10**12 + 10, 7, 17]
    names = [Order.NEW, Order.NEW, Order.REPEATED, Order.STALE, Order.NEW, Order.AHEAD, Order.NEW,
             Order.AHEAD, Order.RESTARTED, Order.STALE, Order.RESTARTED]
    assert [order.judge(stamp) for stamp in stamps] == names
    assert valid_stamp(3, 999_999_999) and not valid_stamp(3, 10**9) and not valid_stamp(-1, 0)


def test_what_came_stays_and_what_was_lost_is_interpolated() -> None:
    rng = np.random.default_rng(1)
    keep = np.sort(rng.choice(1000, 990, replace=False))
    keep = np.unique([0, *keep, 999])
    time = 100.0 + 0.005 * keep + rng.uniform(-2e-4, 2e-4, len(keep))
    grid = even_grid(time, 'log')
    assert (grid.samples, grid.lost) == (1000, 1000 - len(keep))
    assert grid.interval == pytest.approx(0.005, rel=1e-5)
    wave = np.sin(2.0 * np.pi * 5.0 * 0.005 * np.arange(1000))[:, None]
    rows = wave[keep]
    np.testing.assert_array_equal(fill_by_spline(grid, rows)[grid.place], rows)
    np.testing.assert_allclose(fill_by_spline(grid, rows), wave, atol=1e-4)
    lost = np.setdiff1d(np.arange(1000), keep)
    np.testing.assert_allclose(fill_by_line(grid, rows)[lost], wave[lost], atol=0.02)


def test_stamps_that_jitter_by_all_that_is_allowed_keep_their_places() -> None:
    """Neighbours 0.51 T apart were refused where rows were lost: the median is above T."""
    rng = np.random.default_rng(4)
    keep = np.setdiff1d(np.arange(4000), rng.integers(1, 3999, 300))
    time = 0.005 * (keep + rng.uniform(-0.248, 0.248, len(keep)))
    assert 0.0025 < np.min(np.diff(time)) < 0.5 * np.median(np.diff(time))
    grid = even_grid(time, 'log')
    np.testing.assert_array_equal(grid.place, keep[grid.first:grid.last] - keep[grid.first])
    assert grid.interval == pytest.approx(0.005, rel=1e-4)


@pytest.mark.parametrize('share', [0.0, 0.6, 1.0])
def test_angles_tell_whether_samples_were_taken_when_their_stamps_say(share: float) -> None:
    """Swept sines of an arm, read with the noise of an encoder, some samples lost."""
    rng = np.random.default_rng(5)
    keep = np.setdiff1d(np.arange(3000), rng.integers(1, 2999, 40))
    late = rng.normal(0.0, 6e-4, len(keep))

    def angles(time: Array) -> Array:
        return np.stack([0.5 * np.sin(3.0 * time + 0.1 * time**2), 0.3 * np.cos(5.0 * time)],
                        axis=1)

    read = angles(0.01 * keep + share * late) + rng.normal(0.0, 2e-5, (len(keep), 2))
    time = 100.0 + 0.01 * keep + late
    grid = even_grid(time, 'log')
    found = stamp_share(grid, time, read)
    assert abs(found.value - share) < 4.0 * found.error < 0.1
    assert found.is_sure == (share > 0.0)
    if found.is_sure:
        taken = grid.place + found.value * deviations(grid, time)
        even, kept = angles(grid.start - 100.0 + grid.time), fill_by_spline(grid, read)
        error = np.std(fill_by_spline(grid, read, taken) - even)
        assert error < 4e-5 < 0.2 * np.std(kept - even)


def test_an_arm_that_rests_does_not_tell() -> None:
    rng = np.random.default_rng(6)
    time = 0.01 * np.arange(1000) + rng.normal(0.0, 6e-4, 1000)
    grid = even_grid(time, 'log')
    for rest in (np.zeros((1000, 2)), rng.normal(0.0, 2e-5, (1000, 2))):
        assert not stamp_share(grid, time, rest).is_sure


def test_commands_that_are_sent_late_act_late() -> None:
    """Against the mean of a finely drawn staircase; a lost row lies between its neighbours."""
    rng = np.random.default_rng(7)
    late = np.r_[0.004, rng.uniform(-0.3, 0.3, 30)]
    late[12] = 0.0
    values = rng.normal(size=(31, 2))
    values[12] = 0.5 * (values[11] + values[13])
    fine = (np.arange(31 * 1000) + 0.5) / 1000.0
    row = np.maximum(np.searchsorted(np.arange(31) + late, fine, side='right') - 1, 0)
    expected = values[row].reshape(31, 1000, 2).mean(axis=1)
    kept = np.delete(np.arange(31), 12)
    grid = even_grid(0.01 * kept.astype(float), 'log')
    found = fill_by_hold(grid, values[kept], kept + late[kept])
    np.testing.assert_allclose(found, expected, atol=5e-3)


def test_a_long_gap_leaves_the_longest_stretch() -> None:
    time = np.concatenate([np.arange(100), np.arange(150, 450)]) * 0.01
    grid = even_grid(time, 'log')
    assert (grid.first, grid.last, grid.dropped, grid.lost) == (100, 400, 100, 0)
    with pytest.raises(InputError, match='row 3: time: expected 0.01 s after the row before'):
        even_grid(np.array([0.0, 0.01, 0.02, 0.0205, 0.03, 0.04]), 'log')


@pytest.mark.parametrize('time, words', [
    # Stamps that jitter by 0.3 T to either side.
    (0.01 * (np.arange(300) + np.random.default_rng(1).uniform(-0.3, 0.3, 300)),
     r'row \d+: time: expected 0\.0\d+ s after the row before, at least half of it, got 0\.004'),
    (0.01 * np.arange(300) + 0.0049 * (np.arange(300) == 100),
     r'row 100: time: expected .* every 0\.00999\d+ s, at most 0\.4 of it off, got one 0\.00488'),
    (0.01 * np.cumsum(1.0 + (np.arange(300) % 5 == 0)),
     r'row 5: time: expected 0.01 s .* 59 of 359 samples are lost, at most 10% may be')])
def test_times_that_are_too_uneven_are_told_with_the_limit(time: Array, words: str) -> None:
    with pytest.raises(InputError, match=words) as refused:
        even_grid(time, 'log.csv')
    assert 'lost' in words or 'stamp samples when they are taken' in str(refused.value)


def test_limits_follow_from_the_robot_file() -> None:
    limits = Limits.of(QUANSER)
    # Half a turn with 8.925 x 0.94 N m on rotor and link; a quarter turn of the tip: pi b / (2 L),
    # (36) for a tip force.
    drive, link = QUANSER.drives[0], QUANSER.links[0]
    carried = drive.inertia + link.mass * link.length**2 / 3.0
    assert 0.5 * carried * limits.speed[0]**2 == pytest.approx(8.925 * 0.94 * math.pi)
    assert limits.high[2] == pytest.approx(math.pi * 0.00127 / (2 * 0.202))
    assert limits.command == pytest.approx([1.88, 2.4])


def test_angles_are_believed_as_far_as_the_file_says_and_16_turns_without() -> None:
    told = replace(REFERENCE, angle_limits=((-1.0, 2.0), (-200.0, 200.0)))
    margin = 8.0 * REFERENCE.angle_noise
    assert Limits.of(told).low[:2] == pytest.approx([-1.0 - margin, -200.0 - margin], abs=1e-12)
    assert Limits.of(told).high[:2] == pytest.approx([2.0 + margin, 200.0 + margin], abs=1e-12)
    assert Limits.of(REFERENCE).high[:2] == pytest.approx(32.0 * math.pi + margin, abs=1e-12)
    # Set-points have no noise.
    assert angle_ranges(told).tolist() == [[-1.0, 2.0], [-200.0, 200.0]]


@pytest.mark.parametrize('step', [0.0, 2e-3])
def test_a_joint_that_rests_on_its_stop_is_believed(step: float) -> None:
    # An encoder's noise is its step over the root of twelve.
    robot = replace(REFERENCE, angle_noise=step / 12**0.5 or 2e-4,
                    angle_limits=((-0.5, 0.5 - 0.4 * step), (-2.0, 2.0)))
    time, output, command = motion(10_000)
    output[:, 0] = 0.5 + np.random.default_rng(1).normal(0.0, robot.angle_noise, 10_000) \
        if not step else 0.5
    assert not any(judge_record(Gate(robot), time, output, command))
    output[5000, 0] += 0.05
    assert sum(map(bool, judge_record(Gate(robot), time, output, command))) == 1


def motion(samples: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    time = 0.01 * np.arange(float(samples))
    output = np.zeros((samples, 6))
    output[:, 0] = 0.5 * np.sin(3.0 * time)
    return time, output, np.zeros((samples, 2))


@pytest.mark.parametrize('column, value, kind', [
    (0, 1e9, 'out of range'), (1, 20.0, 'too fast'), (1, -5.0, 'too fast'),
    (2, 1.0, 'out of range'), (4, -0.02, 'out of range'), (5, math.nan, 'not finite'),
    (0, math.inf, 'not finite')])
def test_one_bad_sample_is_refused_and_no_other(column: int, value: float, kind: str) -> None:
    time, output, command = motion(100)
    output[50, column] = value
    gate = Gate(REFERENCE)
    refused = judge_record(gate, time, output, command)
    assert [k for k, refusal in enumerate(refused) if refusal is not None] == [50]
    assert gate.refused == {kind: 1}


def test_a_joint_with_less_friction_than_its_file_says_is_believed() -> None:
    # A sixth of the file's: it coasts at 4 rad/s where the file's would let it go at 0.7.
    time = 0.002 * np.arange(1000.0)
    output, command = np.zeros((1000, 4)), np.zeros((1000, 2))
    output[:, 1] = 4.0 / 6.0 * np.sin(6.0 * time)
    assert judge_record(Gate(QUANSER), time, output, command) == [None] * 1000
    first, second = (replace(drive, command_limit=1.0) for drive in REFERENCE.drives)
    slower = replace(REFERENCE, drives=(first, second))
    # A velocity loop goes as fast as it is told.
    assert Limits.of(slower).speed == pytest.approx([3.0, 3.0])


def test_a_command_beyond_the_drive_is_refused() -> None:
    time, output, command = motion(10)
    command[3, 1], command[5, 0] = 1e308, math.nan
    gate = Gate(QUANSER)
    judge_record(gate, time, output[:, :4], command)
    assert gate.refused == {'out of range': 1, 'not finite': 1}


@pytest.mark.parametrize('turns', [-1, 1, 2])
def test_a_wrapped_angle_is_never_believed_and_the_joint_is_when_it_is_back(turns: int) -> None:
    time, output, command = motion(1000)
    output[300:700, 0] += turns * 2.0 * math.pi
    refused = [r is not None for r in judge_record(Gate(REFERENCE), time, output, command)]
    assert all(refused[300:700]) and not any(refused[:300]) and not any(refused[720:])


def test_an_arm_that_was_moved_is_believed_in_the_end() -> None:
    time, output, command = motion(100)
    output[50:, 0] += 50.0
    refused = [r is not None for r in judge_record(Gate(REFERENCE), time, output, command)]
    assert sum(refused) == Gate.CONVINCED and not any(refused[60:])
