"""Logs: three formats say the same, and one line for every way to get them wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

from flex_plant_sim.arm.robot_file import load_robot, parse_robot, robot_text
from flex_plant_sim.atomic_file import whole_file
from flex_plant_sim.inputs.gate import Refusal
from flex_plant_sim.inputs.plausible import unit_hint
from flex_plant_sim.logs.bag_log import write_bag
from flex_plant_sim.logs.csv_log import write_csv
from flex_plant_sim.logs.log import Log
from flex_plant_sim.logs.read import read_log
from msg_config.errors import InputError
from msg_config.input_mapping import InputMapping, Source
import numpy as np
import pytest

ROBOT = load_robot('reference')
HEADER = 'time,command_1,command_2,joint_1,joint_2,strain_1a,strain_1b,strain_2a,strain_2b'
FORMATS: tuple[Literal['mcap', 'sqlite3'], ...] = ('mcap', 'sqlite3')


def some_log(rows: int = 50) -> Log:
    """Return a log of random numbers, exact in nine digits."""
    rng = np.random.default_rng(7)
    columns = rng.integers(-10**6, 10**6, (rows, 10)) / 1e6
    return Log('some', 0.01 * np.arange(float(rows)), columns[:, :2], 0.1 * columns[:, 2:4],
               0.001 * columns[:, 4:8], ROBOT.gauge_names)


def assert_same(found: Log, expected: Log) -> None:
    for name in ('time', 'command', 'joint', 'strain'):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=0,
                                   atol=1e-12, err_msg=name)
    assert found.gauge_names == expected.gauge_names


def test_csv_round_trip(tmp_path: Path) -> None:
    write_csv(tmp_path / 'log.csv', some_log())
    found = read_log(tmp_path / 'log.csv', ROBOT)
    assert_same(found, some_log())
    assert found.sample_time == 0.01


def test_velocities_are_not_read(tmp_path: Path) -> None:
    write_csv(tmp_path / 'log.csv', some_log())
    head, *rows = (tmp_path / 'log.csv').read_text().splitlines()
    for text in ('none', '1e300'):
        (tmp_path / 'log.csv').write_text('\n'.join([
            f'{head},velocity_1,velocity_2', *(f'{row},{text},0' for row in rows), '']))
        found = read_log(tmp_path / 'log.csv', ROBOT)
        assert_same(found, some_log())
        assert not found.notes


@pytest.mark.parametrize('storage', FORMATS)
def test_bag_round_trip(tmp_path: Path, storage: Literal['mcap', 'sqlite3']) -> None:
    write_bag(tmp_path / 'bag', some_log(), storage)
    assert_same(read_log(tmp_path / 'bag', ROBOT), some_log())


def test_an_arm_s_own_file_reads_what_was_written_for_it(tmp_path: Path) -> None:
    robot = parse_robot(robot_text('reference') + """
inputs:
  joints: {joint_1: {name: base, unit: deg, sign: -1, offset: 0.5}, joint_2: forearm}
  commands: {joint_1: {name: amps, scale: 2}}
  gauges: {strain_1a: {name: sg7, unit: um/m}}
  topics: {strain: /daq/strain}
  time: {name: t, unit: ms}
""", 'arm.yaml')
    log = some_log()
    write_csv(tmp_path / 'log.csv', log, robot.inputs)
    head, first, *_ = (tmp_path / 'log.csv').read_text().splitlines()
    assert head.startswith('t,amps,command_2,base,forearm,sg7,strain_1b,')
    degrees, strain = (float(first.split(',')[k]) for k in (3, 5))
    assert degrees == pytest.approx(np.degrees(0.5 - log.joint[0, 0]))
    assert strain == pytest.approx(1e6 * log.strain[0, 0])
    write_bag(tmp_path / 'bag', log, inputs=robot.inputs)
    for name in ('log.csv', 'bag'):
        found = read_log(tmp_path / name, robot)
        for part in ('time', 'command', 'joint', 'strain'):
            np.testing.assert_allclose(getattr(found, part), getattr(log, part), rtol=0,
                                       atol=1e-8, err_msg=f'{name}: {part}')


@pytest.mark.parametrize('storage, suffix', [('mcap', 'mcap'), ('sqlite3', 'db3')])
def test_single_file_of_a_bag(tmp_path: Path, storage: Literal['mcap', 'sqlite3'],
                              suffix: str) -> None:
    write_bag(tmp_path / 'bag', some_log(), storage)
    assert_same(read_log(tmp_path / 'bag' / f'bag.{suffix}', ROBOT), some_log())


def test_csv_and_bag_of_a_real_record_agree(shared_data: Path, tmp_path: Path) -> None:
    log = read_log(shared_data / 'bench' / 'case_8009d8b8.csv', ROBOT)
    write_bag(tmp_path / 'bag', log)
    assert_same(read_log(tmp_path / 'bag', ROBOT), log)


def test_shared_records_read_as_their_readme_says(shared_data: Path) -> None:
    bench = read_log(shared_data / 'bench' / 'case_8009d8b8.csv', ROBOT)
    assert (len(bench), bench.sample_time) == (4000, 0.01)
    quanser = load_robot('quanser_2dsfl')
    real = read_log(shared_data / 'quanser_2dsfl' / 'square_10s.csv', quanser)
    assert (len(real), real.sample_time) == (25500, 0.002)
    # ±25 degrees and ±10 degrees, within the controller's overshoot.
    assert np.degrees(np.abs(real.joint).max(axis=0)) == pytest.approx([25.0, 10.0], abs=5.0)


@pytest.mark.parametrize('every, section, note', [
    ('0.01', '', ''), ('0.02', '', 'sampled every 0.02 s, not 0.01 s'),
    ('10', '', 'time: a sample every 10, taken as ms'),
    ('10000', '', 'time: a sample every 10000, taken as us'),
    ('5', 'inputs: {time: {unit: ms}}', 'sampled every 0.005 s, not 0.01 s'),
    ('1', 'inputs: {time: {scale: 0.01}}', ''),
    ('0.2', 'inputs: {time: {unit: ms, scale: 50}}', '')])
def test_the_clock_is_in_the_unit_that_is_named_or_sure(
        tmp_path: Path, every: str, section: str, note: str) -> None:
    robot = parse_robot(f'{robot_text("reference")}\n{section}\n', 'arm.yaml')
    rows = [f'{float(every) * k:g},1,2,3,4,.005,.004,.003,.002' for k in range(6)]
    (tmp_path / 'log.csv').write_text('\n'.join([HEADER, *rows]) + '\n')
    log = read_log(tmp_path / 'log.csv', robot)
    told = {'sampled every 0.02 s, not 0.01 s': 0.02, 'sampled every 0.005 s, not 0.01 s': 0.005}
    assert log.sample_time == pytest.approx(told.get(note, 0.01))
    assert not log.doubts and [n.startswith(note) for n in log.notes] == [True] * bool(note)


def test_ms_that_jitter_and_lose_rows_are_taken_as_ms(tmp_path: Path) -> None:
    """The median of such intervals was a thousandth and more off, so that their unit was asked."""
    rng = np.random.default_rng(2)
    kept = np.setdiff1d(np.arange(400), rng.integers(1, 399, 20))
    time = 10.0 * (kept + rng.uniform(-0.2, 0.2, len(kept)))
    assert abs(np.median(np.diff(time)) - 10.0) > 0.01
    rows = [f'{t:.9g},1,2,3,4,.005,.004,.003,.002' for t in time]
    (tmp_path / 'log.csv').write_text('\n'.join([HEADER, *rows]) + '\n')
    log = read_log(tmp_path / 'log.csv', ROBOT)
    assert log.notes[0].endswith(', taken as ms') and len(log) == 400
    assert log.sample_time == pytest.approx(0.01, rel=1e-4)


@pytest.mark.parametrize('every', ['1', '5', '0.0002'])
def test_a_clock_without_a_unit_is_no_clock(tmp_path: Path, every: str) -> None:
    """Row numbers, ms at another rate than the robot file's, 5 kHz."""
    rows = [f'{float(every) * k:g},1,2,3,4,.005,.004,.003,.002' for k in range(6)]
    (tmp_path / 'log.csv').write_text('\n'.join([HEADER, *rows]) + '\n')
    with pytest.raises(InputError) as error:
        read_log(tmp_path / 'log.csv', ROBOT)
    assert str(error.value).endswith(
        f'time: expected a sample about every 0.01 s as reference.yaml says, got one every '
        f'{every}: '
        'name its unit in the robot file, inputs: {time: {unit: ms}}, or of row numbers the '
        'interval, s: {time: {scale: 0.01}}')


def test_a_suffix_in_capitals_is_the_same(tmp_path: Path) -> None:
    write_csv(tmp_path / 'log.csv', some_log())
    (tmp_path / 'log.csv').rename(tmp_path / 'LOG.CSV')
    np.testing.assert_allclose(read_log(tmp_path / 'LOG.CSV', ROBOT).joint, some_log().joint)


def test_columns_in_any_order_and_unknown_ones(tmp_path: Path) -> None:
    rows = ['note,strain_temp_c,' + ','.join(HEADER.split(',')[::-1])]
    rows += [f'7,21,4e-3,3e-3,2e-3,1e-3,20,10,200,100,{0.01 * k:g}' for k in range(3)]
    (tmp_path / 'log.csv').write_text('\ufeff' + '\r\n'.join(rows) + '\r\n', encoding='utf-8')
    log = read_log(tmp_path / 'log.csv', ROBOT)
    np.testing.assert_array_equal(log.output[0], [10, 20, 1e-3, 2e-3, 3e-3, 4e-3])
    np.testing.assert_array_equal(log.command[0], [100, 200])


def good_rows() -> list[str]:
    return [f'{0.01 * k:g},1,2,3,4,.005,.004,.003,.002' for k in range(6)]


def edit(row: int, column: int, text: str) -> Callable[[list[str]], list[str]]:
    def change(rows: list[str]) -> list[str]:
        values = rows[row].split(',')
        values[column] = text
        return [*rows[:row], ','.join(values), *rows[row + 1:]]
    return change


def test_a_step_that_is_possible_in_degrees_is_asked_about() -> None:
    """Half a turn a second in degrees is no angle out of range, but faster than any drive."""
    assert 'degrees' in unit_hint(Refusal('speed', 'joint_2', '', 'rad/s', 180.0, 0.0, 9.0))
    assert not unit_hint(Refusal('speed', 'joint_2', '', 'rad/s', 600.0, 0.0, 9.0))


def read_angles(folder: Path, angle: np.ndarray) -> Log:
    """Return the log of a first joint that may turn by 0.5 rad to either side."""
    rows = np.zeros((len(angle), 9))
    rows[:, 0], rows[:, 3] = 0.01 * np.arange(len(angle)), angle
    np.savetxt(folder / 'a.csv', rows, delimiter=',', header=HEADER, comments='')
    return read_log(folder / 'a.csv', replace(ROBOT, angle_limits=((-0.5, 0.5), (-1.0, 1.0))))


def test_two_sources_in_turn_are_no_angles_in_degrees(tmp_path: Path) -> None:
    apart = np.linspace(0.0, 3.0, 400) * (np.arange(400) % 2)
    rows = np.zeros((400, 9))
    rows[:, 0], rows[:, 4] = 0.005 * np.arange(400), np.sin(0.01 * np.arange(400)) + apart
    np.savetxt(tmp_path / 'a.csv', rows, delimiter=',', header=HEADER, comments='')
    with pytest.raises(InputError, match=r'joint_2: expected at most .* rad/s, got a step .* '
                                         r'\(do two publishers alternate\? keep the rows of one'):
        read_log(tmp_path / 'a.csv', ROBOT)


def test_only_what_is_far_beyond_its_limits_is_taken_for_another_unit(tmp_path: Path) -> None:
    swing = np.sin(0.02 * np.arange(400.0))
    with pytest.raises(InputError, match=r'joint_1: expected .* rad, got 0\.5\d+; '):
        read_angles(tmp_path, 0.6 * swing)
    # Its first sample beyond the limit is as near.
    with pytest.raises(InputError, match=r'got 0\.5\d+ \(is it in degrees\?.*; .* like it'):
        read_angles(tmp_path, np.degrees(0.1 * swing))


FAULTS: list[tuple[str, Callable[[list[str]], list[str]], str]] = [
    (HEADER, edit(2, 4, 'nan'), 'line 4: joint_2: expected a finite number, got nan'),
    (HEADER, edit(3, 7, 'inf'), 'line 5: strain_2a: expected a finite number, got inf'),
    (HEADER, edit(1, 2, '-inf'),
     'line 3: command of joint_2: expected a finite number, got -inf'),
    (HEADER, edit(5, 0, 'nan'), 'line 7: time: expected a finite number, got nan'),
    (HEADER, edit(2, 3, ''), 'line 4: joint_1: expected a finite number, got nan'),
    (HEADER, edit(2, 3, '1e6'), 'line 4: joint_1: expected -100.5 to 100.5 rad, got 1e+06'),
    (HEADER, edit(2, 5, '430'), 'line 4: strain_1a: expected -0.007854 to 0.007854 m/m, got 430 '
                                '(is it in µm/m (microstrain)? say so'),
    (HEADER, edit(2, 5, '0.43'), 'line 4: strain_1a: expected -0.007854 to 0.007854 m/m, got '
                                 '0.43 (is it in µm/m (microstrain) or mm/m or percent? say so'),
    (HEADER, edit(2, 3, 'many'), "line 4: joint_1: expected a number, got 'many'"),
    (HEADER, edit(4, 8, '.002,9'), 'line 6: expected 9 columns, got 10'),
    (HEADER, edit(2, 3, '0_1'), "line 4: joint_1: expected a number, got '0_1'"),
    (HEADER, edit(2, 3, '"0,1"'), "line 4: joint_1: expected a number, got '0,1'"),
    (HEADER, edit(2, 3, '3e-0,1e-05,'), 'line 4: expected exponents of two digits as elsewhere, '
                                        "got 'e-0': a number was cut"),
    (HEADER, edit(3, 0, '0.02'), 'line 5: time: expected more than 0.02 s, got 0.02 s: 1 of 6 '
                                 'rows have the time of the row before; keep one of each'),
    (HEADER, edit(3, 0, '0.005'), 'line 5: time: expected more than 0.02 s, got 0.005 s: the '
                                  'clock goes back; are two logs joined?'),
    (HEADER, lambda rows: [f'1700000000{row[1:]}' for row in [*rows[:2], rows[1]]],
     'line 4: time: expected more than 1700000000.01 s, got 1700000000.01 s'),
    (HEADER, lambda rows: rows[:3] + rows[4:], 'line 5: time: expected 0.01 s after the row '
                                               'before, got 0.02 s'),
    (HEADER, lambda rows: rows[:1], 'expected at least 2 samples, got 1'),
    (HEADER, lambda rows: [], 'expected at least 2 samples, got 0'),
    (HEADER.replace('joint_2', 'angle_2'), lambda rows: rows, 'column joint_2: missing, got '),
    (HEADER.replace('time', 't'), lambda rows: rows, 'column time: missing, got t, '),
    (HEADER.replace('joint_2', 'joint_1'), lambda rows: rows, 'column joint_1: expected once, '
                                                              'got 2'),
    (HEADER.replace('strain_2b', 'spare'), lambda rows: rows,
     'strain: expected 4 gauges (strain_1a, strain_1b, strain_2a, strain_2b) for '
     'reference.yaml, got 3 (strain_1a, strain_1b, strain_2a)'),
    (HEADER.replace('strain_2b', 'strain_2c'), lambda rows: rows, 'column strain_2b: missing'),
]


def test_gauges_that_the_robot_file_lacks_are_left_alone_once_its_own_are_named(
        tmp_path: Path) -> None:
    write_csv(tmp_path / 'log.csv', some_log())
    one = ROBOT.with_link(1, gauge_positions=()).with_link(0, gauge_positions=(0.03,))
    with pytest.raises(InputError) as error:
        read_log(tmp_path / 'log.csv', one)
    assert str(error.value) == (
        f'{tmp_path}/log.csv: strain: expected 1 gauge (strain_1) for reference.yaml, got 4 '
        f"({', '.join(ROBOT.gauge_names)}); to leave the others alone, name the arm's under "
        'inputs: in the robot file')
    named = replace(one, inputs=InputMapping(gauges={'strain_1': Source('strain_1b')}))
    found = read_log(tmp_path / 'log.csv', named)
    np.testing.assert_allclose(found.strain[:, 0], some_log().strain[:, 1], atol=1e-12)


@pytest.mark.parametrize('note', ['"ok, fine"', 'sensor 2e', '"a ""quoted"" one, 1e"', 'Δ'])
def test_text_in_a_column_that_is_not_read_does_no_harm(tmp_path: Path, note: str) -> None:
    path = tmp_path / 'log.csv'
    path.write_text('\n'.join([f'{HEADER},note', *(
        f'{row},{note if k % 2 else 1e-5}' for k, row in enumerate(good_rows()))]) + '\n')
    assert read_log(path, ROBOT).joint.tolist() == [[3.0, 4.0]] * 6


@pytest.mark.parametrize('separator', [',', ';'])
def test_quoted_decimal_commas_are_read_and_said(tmp_path: Path, separator: str) -> None:
    path, expected = tmp_path / 'log.csv', some_log()
    write_csv(path, expected)
    lines = [line.split(',') for line in path.read_text().splitlines()
             if not line.startswith('#')]
    path.write_text('\n'.join(separator.join(f'"{cell.replace(".", ",")}"' for cell in line)
                              for line in lines) + '\n')
    found = read_log(path, ROBOT)
    assert_same(found, expected)
    assert 'decimal commas read as points' in found.notes


def test_quoted_thousands_are_refused_as_they_stand(tmp_path: Path) -> None:
    path = tmp_path / 'log.csv'
    for cell, other in (('1,234', '1'), ('1,234.5', '1'), ('0,5', '1.5')):
        rows = [f'{k},"{cell}",{other},0,0,0,0,0,0' for k in range(3)]
        path.write_text('\n'.join([HEADER, *rows]) + '\n')
        with pytest.raises(InputError, match=f"command_1: expected a number, got '{cell}'"):
            read_log(path, ROBOT)


@pytest.mark.parametrize('header, change, message', FAULTS)
def test_a_fault_in_a_csv_is_named_in_one_line(
        tmp_path: Path, header: str, change: Callable[[list[str]], list[str]],
        message: str) -> None:
    path = tmp_path / 'log.csv'
    path.write_text('\n'.join([header, *change(good_rows())]) + '\n')
    with pytest.raises(InputError) as error:
        read_log(path, ROBOT)
    assert str(error.value).startswith(f'{path}: {message}')
    assert '\n' not in str(error.value)


def test_parts_of_a_log() -> None:
    part = some_log().part(10, 20)
    assert len(part) == 10
    np.testing.assert_array_equal(part.output, some_log().output[10:20])
    assert part.sample_time == pytest.approx(0.01)


def test_nothing_is_left_half_written(tmp_path: Path) -> None:
    """After Ctrl-C in the midst of writing, the old file stands and no other does."""
    target = tmp_path / 'results.json'
    target.write_text('old, written by flex_payload')
    with pytest.raises(KeyboardInterrupt), whole_file(target) as temporary:
        temporary.write_text('new, but not all of')
        raise KeyboardInterrupt
    assert target.read_text() == 'old, written by flex_payload'
    assert list(tmp_path.iterdir()) == [target]


def test_a_bag_replaces_nothing(tmp_path: Path) -> None:
    write_bag(tmp_path / 'bag', some_log(10))
    with pytest.raises(InputError, match='got a folder that it did not write'):
        write_bag(tmp_path / 'bag', some_log(20))
    assert len(read_log(tmp_path / 'bag', ROBOT)) == 10
    (tmp_path / 'papers').mkdir()
    (tmp_path / 'papers' / 'mine').write_text('mine')
    with pytest.raises(InputError, match='got a folder that it did not write'):
        write_bag(tmp_path / 'papers', some_log(10))
    assert (tmp_path / 'papers' / 'mine').read_text() == 'mine'


def test_writing_into_no_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match='expected an existing folder'):
        write_csv(tmp_path / 'absent' / 'log.csv', some_log())
