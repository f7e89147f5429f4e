"""What a log that was exported wrongly is told, on a record of an arm of finite elements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

from flex_payload_estimator.tools import estimate
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.commissioning.standard_move import simulated_move, standard_move
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.inputs.plausible import channel_hints
from flex_plant_sim.inputs.stale_rows import stale_note
from flex_plant_sim.logs.csv_log import write_csv
from flex_plant_sim.logs.log import Log
from flex_plant_sim.logs.read import read_log
from flex_plant_sim.tools import replay
from flex_plant_sim.tools.log_input import bending_angles, hints, read_logs
from msg_config.errors import InputError
import numpy as np
import pytest
from truth.assembly import assemble
from truth.records import draw_case, make_record, move, TruthCase
from truth.tolerances import TOLD

ROBOT = load_robot('reference')
NAMES = ('time', 'command_1', 'command_2', 'joint_1', 'joint_2', 'strain_1a', 'strain_1b',
         'strain_2a', 'strain_2b')
Spoil = Callable[[np.ndarray], None]


@cache
def table(payload: float = 0.1) -> np.ndarray:
    return make_record(TruthCase(96, (), duration_s=12.0, payload_true=payload)).table


def read(path: Path, spoil: Spoil, payload: float = 0.1) -> Log:
    """Return a log of the arm as it is read, with its numbers spoilt in place."""
    numbers = table(payload).copy()
    spoil(numbers)
    np.savetxt(path, numbers, fmt='%.9g', delimiter=',', header=','.join(NAMES), comments='')
    return read_log(path, ROBOT)


def inverted(*columns: int) -> Spoil:
    def spoil(numbers: np.ndarray) -> None:
        numbers[:, columns] *= -1.0
    return spoil


def scaled(factor: float, *columns: int) -> Spoil:
    def spoil(numbers: np.ndarray) -> None:
        numbers[:, columns] *= factor
    return spoil


def exchanged(*columns: int) -> Spoil:
    def spoil(numbers: np.ndarray) -> None:
        numbers[:, columns] = numbers[:, columns[::-1]]
    return spoil


@pytest.mark.parametrize('spoil, channels, words', [
    (inverted(), (), ''),
    (inverted(6), ('strain_1b',), 'is its sign inverted?'),
    (inverted(4), ('joint_2',), "is its sign, or its command's, inverted?"),
    (inverted(5, 6, 7, 8), NAMES[5:], 'is its sign inverted?'),
    (scaled(7.0, 5), ('strain_1a',), "or the command's, and is it this column?"),
    (scaled(0.1, 5, 6, 7, 8), NAMES[5:], "or the command's, and is it this column?"),
    (scaled(2.0, 5, 6), (), ''),
    (exchanged(5, 6), ('strain_1a and strain_1b',), 'look exchanged'),
    (exchanged(6, 8), ('strain_1b and strain_2b',), 'look exchanged')])
def test_only_what_is_wrong_with_a_channel_is_said(
        tmp_path: Path, spoil: Spoil, channels: tuple[str, ...], words: str) -> None:
    said = hints(read(tmp_path / 'log.csv', spoil), ROBOT)
    assert len(said) == len(channels)
    assert all(line.startswith(name) and line.endswith(words)
               for line, name in zip(said, channels))


@pytest.mark.parametrize('columns, first, others', [
    ((2, 4), 'joint_2', ()), ((1, 3), 'joint_1', ()),
    ((2, 4, 7, 8), 'joint_2', NAMES[7:]),
    # Its mirror image reads alike.
    ((1, 3, 5, 6), 'joint_2', NAMES[7:])])
def test_a_joint_that_is_counted_the_other_way_round_is_told_by_the_strain(
        tmp_path: Path, columns: tuple[int, ...], first: str, others: tuple[str, ...]) -> None:
    # Angle and command agree, and nothing was said of the first two.
    said = hints(read(tmp_path / 'log.csv', inverted(*columns)), ROBOT)
    assert [line.split(':')[0] for line in said] == [first, *others]
    assert 'angle and command' in said[0] and 'are the signs of both inverted?' in said[0]


@pytest.mark.parametrize('name', ['coulomb_friction', 'gear_compliance', 'payload_mass'])
def test_an_arm_that_is_not_its_model_is_not_counted_the_other_way_round(name: str) -> None:
    case = replace(draw_case(name, 1208001, duration_s=10.0), spread=TOLD)
    record = make_record(case)
    log = Log('x', record.time, record.command, record.joint, record.strain, NAMES[5:])
    assert not any('other way round' in line for line in hints(log, ROBOT))


def test_hints_are_of_an_arm_that_carries_what_is_told(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Links' gauges look exchanged with 0.3 kg, and with the file's 0.1 kg do not."""
    read(tmp_path / 'log.csv', exchanged(5, 7), 0.3)
    for told, said in (('0.1', False), ('0.3', True)):
        assert replay.main([str(tmp_path / 'log.csv'), '--payload', told]) == 0
        assert ('strain_1a and strain_2a look exchanged' in capsys.readouterr().err) == said


@pytest.mark.parametrize('share, said', [(0.0, True), (0.5, False)])
def test_joints_look_exchanged_only_if_each_is_more_like_the_other(share: float, said: bool
                                                                   ) -> None:
    """Joint 1 follows what joint 2 should: by an exchange, or as a fault makes both move alike."""
    time = np.arange(0.0, 10.0, 0.01)
    expected = np.stack([np.sin(2.0 * time), np.sin(3.1 * time + 0.4)], axis=1)
    measured = np.stack([expected[:, 1], (1.0 - share) * expected[:, 0] + share * expected[:, 1]],
                        axis=1)
    found = channel_hints(measured, expected, ('joint_1', 'joint_2'), ('rad', 'rad'),
                          np.full(2, 1e-4))
    assert any('look exchanged' in line for line in found) == said


@pytest.mark.parametrize('columns', [(5, 6), (7, 8)])
def test_gauges_of_a_link_are_told_exchanged_beside_an_untold_payload(
        tmp_path: Path, columns: tuple[int, ...]) -> None:
    assert not hints(read(tmp_path / 'log.csv', inverted(), 0.3), ROBOT)
    said = hints(read(tmp_path / 'log.csv', exchanged(*columns), 0.3), ROBOT)
    first, second = (NAMES[k] for k in columns)
    assert said == (f'{first} and {second} look exchanged',)


@pytest.mark.parametrize('column', [5, 8])
def test_a_gauge_that_dies_is_no_evidence(tmp_path: Path, column: int) -> None:
    def die(numbers: np.ndarray) -> None:
        numbers[700:1100, column] = numbers[700, column]

    def pause(numbers: np.ndarray) -> None:
        numbers[700:800, column] = numbers[700, column]

    def stick(numbers: np.ndarray) -> None:
        numbers[700:725, column] = numbers[700, column]

    for spoil, last in ((pause, 801), (stick, 726)):
        log = read(tmp_path / 'log.csv', spoil)
        assert f'from line 702 to line {last} while' in log.notes[0] and not log.doubts
    doubt, = read(tmp_path / 'log.csv', die).doubts
    assert doubt == (f'{NAMES[column]}: does not change from line 702 to line 1101 while the '
                     'others move: dead, or not connected?')


def test_a_few_equal_readings_are_chance(tmp_path: Path) -> None:
    for length, said in ((3, False), (4, False), (25, True)):
        def repeat(numbers: np.ndarray, length: int = length) -> None:
            # Where it moves fastest.
            first = int(np.argmax(np.abs(numbers[3:, 5] - numbers[:-3, 5])))
            numbers[first:first + length, 5] = numbers[first, 5]
        assert any('does not change' in note
                   for note in read(tmp_path / 'log.csv', repeat).notes) == said


def test_a_coarse_or_clipped_gauge_is_not_dead(tmp_path: Path) -> None:
    def spoil(numbers: np.ndarray) -> None:
        most = np.abs(numbers[:, 5:7]).max(axis=0)
        numbers[:, 5] = np.clip(numbers[:, 5], -0.5 * most[0], 0.5 * most[0])
        numbers[:, 6] = np.round(numbers[:, 6] / most[1] * 5.0) * most[1] / 5.0
    assert not read(tmp_path / 'log.csv', spoil).doubts


@pytest.mark.parametrize('every', [2, 5])
@pytest.mark.parametrize('columns', [range(3, 9), range(7, 9), (4,)])
def test_measurements_that_are_held_are_no_evidence(
        tmp_path: Path, every: int, columns: tuple[int, ...]) -> None:
    def hold(numbers: np.ndarray) -> None:
        for k in columns:
            numbers[:, k] = np.repeat(numbers[::every, k], every)
    names = ', '.join(NAMES[k] for k in columns)
    doubt, = read(tmp_path / 'log.csv', hold).doubts
    assert doubt.startswith(f'{names}: change')
    assert f'only every {every} samples, of 10 ms' in doubt


@pytest.mark.parametrize('coarse', [False, True])
def test_rows_that_repeat_the_one_before_are_told_where_noise_never_does(
        tmp_path: Path, coarse: bool) -> None:
    def repeat(numbers: np.ndarray) -> None:
        if coarse:
            # At rest these stay the same.
            numbers[:700, 1:] = 0.0
            numbers[:, 3:5] = np.round(numbers[:, 3:5], 2)
        for k in range(720, 1100, 40):
            numbers[k + 1:k + 4, 3:] = numbers[k, 3:]
    said = [note for note in read(tmp_path / 'log.csv', repeat).notes if 'row before' in note]
    assert [note[:40] for note in said] == [
        '30 of 1200 rows have all readings of the'] * (not coarse)
    assert coarse or 'first line 723:' in said[0]


def test_rows_that_repeat_at_a_short_rest_are_no_stale_ones() -> None:
    chance = np.random.default_rng(2)
    for _ in range(20):
        readings = np.cumsum(chance.normal(size=(3000, 6)), axis=0)
        readings[:60] = chance.random((60, 6)) < 0.1
        assert (readings[1:60] == readings[:59]).all(axis=1).any()
        assert not stale_note(readings, str)
        stale = np.insert(readings, 1500, readings[1500], axis=0)
        assert stale_note(stale, str).startswith('1 of 3001 rows have all readings of the row '
                                                 'before, first 1501:')


def test_commands_that_are_held_and_coarse_angles_are_evidence(tmp_path: Path) -> None:
    def spoil(numbers: np.ndarray) -> None:
        numbers[:, 1] = np.repeat(numbers[::2, 1], 2)
        numbers[:, 3:5] = np.round(numbers[:, 3:5], 2)
    assert not read(tmp_path / 'log.csv', spoil).doubts


@pytest.mark.parametrize('spell, said', [
    (str.capitalize, 'column time: missing, got Time, Command_1, '),
    (lambda name: name.replace('_', ' '), 'column command_1: missing, got time, command 1, '),
    (lambda name: f'{name} [SI]', 'column time: missing, got time [SI], ')])
def test_names_that_are_spelt_otherwise_are_shown(
        tmp_path: Path, spell: Callable[[str], str], said: str) -> None:
    path = tmp_path / 'log.csv'
    np.savetxt(path, table(), delimiter=',', header=','.join(map(spell, NAMES)), comments='')
    with pytest.raises(InputError, match='inputs: in the robot file$') as error:
        read_log(path, ROBOT)
    assert str(error.value).startswith(f'{path}: {said}')


def test_lost_rows_leave_the_noise_as_it_is(tmp_path: Path) -> None:
    """Interpolated rows are smoother; taken as noise they made a clean arm unexplained."""
    rng, size = np.random.default_rng(2), np.repeat([1e-3, 1e-5], [2, 4])
    numbers = np.tile(0.01 * np.arange(4000.0)[:, None], 9)
    numbers[:, 1:] = np.sin(numbers[:, 1:]) * np.repeat([1.0, 1e-3], [4, 4])
    numbers[:, 3:] += size * rng.standard_normal((4000, 6))
    kept = np.sort(rng.choice(4000, 3640, replace=False))
    np.savetxt(tmp_path / 'log.csv', numbers[kept], fmt='%.9g', delimiter=',',
               header=','.join(NAMES), comments='')
    log = read_log(tmp_path / 'log.csv', ROBOT)
    assert log.lost is not None and log.lost.sum() > 300
    noise, = Data.of([Record.of(log, 0.1)], 10.0, 0.01).noise
    assert noise == pytest.approx(size, rel=0.1)


def test_commands_in_thousandths_of_their_unit_are_asked_about(tmp_path: Path) -> None:
    def in_thousandths(numbers: np.ndarray) -> None:
        numbers[:, 1:3] *= 1000.0
    with pytest.raises(InputError, match=r'\(in another unit\? scale it under inputs: ') as error:
        read(tmp_path / 'log.csv', in_thousandths)
    assert 'command of joint_' in str(error.value)


def test_comments_may_stand_anywhere_but_are_no_header(tmp_path: Path) -> None:
    path = tmp_path / 'log.csv'
    np.savetxt(path, table(), delimiter=',', header=','.join(NAMES), comments='')
    lines = path.read_text().splitlines()
    path.write_text('\n'.join(['# Monday', *lines[:9], '# pause', *lines[9:], '# end', '']))
    assert len(read_log(path, ROBOT)) == len(table())
    path.write_text('\n'.join([f'# {lines[0]}', *lines[1:], '']))
    with pytest.raises(InputError, match=r'names the columns and is no comment \(#\)'):
        read_log(path, ROBOT)


def test_gauges_of_two_links_are_told_by_their_shape_not_by_their_size() -> None:
    # A payload that is heavier than told turns round which link bends more.
    t = 0.01 * np.arange(1000)
    names, units = ('joint_1', 'joint_2', 'strain_1', 'strain_2'), ('rad', 'rad', 'm/m', 'm/m')
    angles = [np.sin(t), np.cos(2.0 * t)]
    expected = np.column_stack([*angles, 2e-4 * np.sin(7.0 * t), 1e-4 * np.cos(9.0 * t)])
    heavier = np.column_stack([*angles, 1.0e-4 * np.sin(7.0 * t), 2.5e-4 * np.cos(9.0 * t)])
    noise = np.array([1e-4, 1e-4, 1e-7, 1e-7])
    assert not channel_hints(heavier, expected, names, units, noise)
    assert channel_hints(expected[:, [0, 1, 3, 2]], expected, names, units, noise) == (
        'strain_1 and strain_2 look exchanged',)


@pytest.mark.parametrize('noisier, factor, said', [
    (1.0, 1.0, False), (2.5, 1.0, False), (1.0, 100.0, True)])
def test_noise_that_buries_increments_is_no_wrong_unit(
        noisier: float, factor: float, said: bool) -> None:
    """At 500 Hz, what moves slowly moves less from row to row than sensors err."""
    noise, rng = np.array([1.5e-5, 1.5e-5, 1e-6, 1e-6]), np.random.default_rng(3)
    slow = np.sin(np.outer(0.002 * np.arange(5000.0), [0.7, 0.5, 0.4, 0.3]))
    expected = slow * [1.0, 1e-4, 1e-5, 1e-5]
    measured = factor * (expected + noisier * noise * rng.standard_normal(slow.shape))
    names, units = ('joint_1', 'joint_2', 'strain_1', 'strain_2'), ('rad', 'rad', 'm/m', 'm/m')
    found = channel_hints(measured, expected, names, units, noise)
    assert [line.split(':')[0] for line in found] == (list(names) if said else [])


@pytest.mark.parametrize('dead', [2, 3])
def test_a_dead_gauge_looks_exchanged_with_none(dead: int) -> None:
    noise = np.random.default_rng(5).standard_normal((1000, 4))
    expected = np.cumsum(noise * [0.01, 0.01, 3e-5, 1e-5], axis=0)
    names, units = ('joint_1', 'joint_2', 'strain_1', 'strain_2'), ('rad', 'rad', 'm/m', 'm/m')
    # The other gauge is as large as the dead one should be.
    measured = 1.5 * expected
    measured[:, 2:] = expected[:, 2:] @ [[0.0, 1.0], [1.0, 0.0]]
    std = np.full(4, 1e-9)
    assert any('look exchanged' in hint for hint in channel_hints(
        measured, expected, names, units, std))
    measured[:, dead] = 1e-6
    assert not any('look exchanged' in hint for hint in channel_hints(
        measured, expected, names, units, std))


def test_a_log_counts_once(tmp_path: Path) -> None:
    (tmp_path / 'log.csv').touch()
    (tmp_path / 'link.csv').symlink_to(tmp_path / 'log.csv')
    with pytest.raises(InputError, match='link.csv: expected each log once'):
        read_logs([str(tmp_path / 'log.csv'), str(tmp_path / 'link.csv')], ROBOT, 'paper', 2)


@pytest.mark.parametrize('name', ['reference', 'quanser_2dsfl'])
def test_links_bend_as_far_as_finite_elements_do(name: str) -> None:
    case = TruthCase(5, robot=name, duration_s=6.0, payload_true=0.15, tolerances=False)
    arm, motion = move(case)
    found = bending_angles(make_record(case).strain, load_robot(name))
    system, deflections = assemble(arm), motion.state[:, 0, 2:]
    first = system.upper.a.size
    turned = np.stack([deflections[:, :first] @ system.upper.tip_slope,
                       deflections[:, first:] @ system.lower_empty.tip_slope], axis=-1)
    np.testing.assert_allclose(np.std(found - turned, axis=0) / np.std(turned, axis=0), 0.0,
                               atol=0.1)


@pytest.mark.parametrize('payload', [0.1, 0.8])
def test_a_log_that_bends_further_than_the_models_hold_for_is_said(
        payload: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / 'log.csv'
    loaded = replace(ROBOT, payload_mass=payload)
    write_csv(path, simulated_move(loaded, standard_move(loaded, 4), 3, 1), ROBOT.inputs)
    read_logs([str(path)], ROBOT, 'assumed_modes', 3)
    diagnosed = capsys.readouterr().err
    assert estimate.main([str(path), '--estimator', 'sf1', '--modes', '2']) == 0
    assert capsys.readouterr().err == diagnosed
    said = diagnosed.splitlines()
    assert len(said) == (payload > 0.1)
    assert all('bends by 0.45 rad: the models' in line and '20 %' in line for line in said)
