"""Angles that step further than a joint turns: slips of encoders are kept, turns undone."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

from attack.run import good_log
from attack.run import ROBOT as REFERENCE
from flex_plant_sim.inputs.gate import Gate, judge_record
from flex_plant_sim.logs.bag_log import write_bag
from flex_plant_sim.logs.csv_log import write_csv
from flex_plant_sim.logs.log import Log
from flex_plant_sim.logs.read import read_log
import numpy as np
import pytest

TURN = 2.0 * np.pi
# At most 9 rad/s: 0.09 rad a sample.
ROBOT = replace(REFERENCE, drives=(replace(REFERENCE.drives[0], command_limit=3.0),
                                   replace(REFERENCE.drives[1], command_limit=3.0)))
LIMITED = replace(ROBOT, angle_limits=((-1.5, 1.5), (-2.0, 2.0)))
good = cache(good_log)


def moved(rows: slice, joint: int, by: float) -> Log:
    log = good(400)
    angle = log.joint.copy()
    angle[rows, joint] += by
    return replace(log, joint=angle)


def reread(log: Log, folder: Path, limited: bool = False) -> Log:
    """Return what is read of a log, which a CSV and a bag agree on."""
    write_csv(folder / 'log.csv', log)
    write_bag(folder / 'log', log)
    found, other = (read_log(folder / name, LIMITED if limited else ROBOT)
                    for name in ('log.csv', 'log'))
    # The last command of a bag has no sample after it.
    np.testing.assert_allclose(found.joint[:len(other)], other.joint, atol=1e-8)
    return found


@pytest.mark.parametrize('joint', [0, 1])
@pytest.mark.parametrize('size', [0.05, 0.12, -0.3, 0.5, -1.0, 2.0])
def test_a_slip_of_any_size_is_kept_and_said(joint: int, size: float, tmp_path: Path) -> None:
    log = moved(slice(200, None), joint, size)
    assert any(judge_record(Gate(ROBOT), log.time, log.output, log.command)) == (abs(size) > 0.1)
    found = reread(log, tmp_path)
    np.testing.assert_allclose(found.joint, log.joint, atol=1e-8)
    note, = found.notes
    said, _, where = note.partition(' at line 202, against all others, and stays')
    assert where and said.startswith(f'joint_{joint + 1} steps by ')
    assert float(said.rpartition(' ')[2]) == pytest.approx(size, abs=0.01)
    assert not found.doubts and found.lost is None
    # What a joint cannot do is sure: the answer begins with it, and nothing is calibrated by it.
    assert found.misread == ((note,) if abs(size) > 0.1 else ())
    assert found.part(10, 300).misread == found.misread


def test_a_slip_that_is_taken_back_is_two(tmp_path: Path) -> None:
    log = moved(slice(200, 240), 1, 0.6)
    found = reread(log, tmp_path)
    np.testing.assert_allclose(found.joint, log.joint, atol=1e-8)
    assert [note.split(', against')[0].rpartition(' at ')[2] for note in found.notes] == [
        'line 202', 'line 242']


@pytest.mark.parametrize('length', [1, 3])
def test_some_wrong_samples_are_no_slip(length: int, tmp_path: Path) -> None:
    found = reread(moved(slice(200, 200 + length), 0, 0.6), tmp_path)
    assert [note.split(' ')[0] for note in found.notes] == [f'{length}', f'{length}']
    assert found.lost is not None and np.flatnonzero(found.lost).tolist() == list(
        range(200, 200 + length))


@pytest.mark.parametrize('limited', [False, True])
@pytest.mark.parametrize('rows', [slice(200, 201), slice(200, 204), slice(100, 390),
                                  slice(0, 40), slice(360, None)])
def test_a_wrapped_angle_is_undone(rows: slice, limited: bool, tmp_path: Path) -> None:
    found = reread(moved(rows, 0, -TURN), tmp_path, limited)
    count = len(range(400)[rows])
    # Without limits, nothing but the number of rows tells which turn is the joint's.
    other = count > 200 and not limited
    np.testing.assert_allclose(found.joint, good(400).joint - [TURN * other, 0.0], atol=1e-8)
    first = 2 if other else rows.start + 2
    assert found.notes == (
        f'joint_1: {400 - count if other else count} of 400 rows are whole turns off, the first '
        f'line {first}: a wrapped angle, undone',)
    assert not found.doubts and found.lost is None


@pytest.mark.parametrize('low', [-np.pi, 0.0])
def test_an_angle_that_wraps_again_and_again_is_undone(low: float, tmp_path: Path) -> None:
    log, shift = good(400), np.array([low, 0.0])
    centred = replace(log, joint=log.joint - log.joint.mean(axis=0) + shift)
    wrapped = np.mod(centred.joint[:, 0] - low, TURN) + low
    found = reread(replace(centred, joint=np.stack([wrapped, centred.joint[:, 1]], 1)), tmp_path)
    assert np.ptp(np.round((found.joint - centred.joint) / TURN, 6), axis=0).tolist() == [0.0, 0.0]
    assert len(found.notes) == 1 and 'a wrapped angle, undone' in found.notes[0]


def test_a_lost_row_where_an_angle_wraps_does_not_matter(tmp_path: Path) -> None:
    log = moved(slice(300, None), 1, TURN)
    log.joint[300, 1] = np.nan
    found = reread(log, tmp_path)
    rows = np.delete(np.arange(400), 300)
    np.testing.assert_allclose(found.joint[rows], good(400).joint[rows], atol=1e-8)
    assert found.lost is not None and found.lost.sum() == 1
