"""The standard move: what a real arm is to play stays within its drives and its angle limits."""

from __future__ import annotations

from pathlib import Path

from flex_plant_sim.arm.robot_file import load_robot, robot_text
from flex_plant_sim.commissioning.standard_move import standard_move
from flex_plant_sim.logs.read import read_log
from flex_plant_sim.tools.robot import main
import numpy as np
import pytest


def limited(folder: Path, name: str, shoulder: str, elbow: str, effects: str = '') -> Path:
    """Return the file of a built-in arm with angle limits."""
    before, first, second = robot_text(name).split('kind: ')
    after = ', ' if before.endswith('{') else '\n    '
    path = folder / 'arm.yaml'
    path.write_text(f'{before}angle_limits_rad: {shoulder}{after}kind: {first}'
                    f'angle_limits_rad: {elbow}{after}kind: {second}{effects}')
    return path


def test_the_move_keeps_within_the_drives() -> None:
    robot = load_robot('quanser_2dsfl')
    move = standard_move(robot)
    limits = [drive.command_limit for drive in robot.drives]
    assert move.stroke > 1.0
    assert np.all(np.abs(move.commands).max(axis=0) <= limits)


@pytest.mark.parametrize('name', ['reference', 'quanser_2dsfl'])
def test_the_move_keeps_within_the_angle_limits(
        name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm, log = limited(tmp_path, name, '[0.2, 2.0]', '[-2.0, -1.2]'), tmp_path / 'log.csv'
    assert main(['move', str(arm), '--strokes', '6', '--output', str(log)]) == 0
    assert 'joint_1 at 0.7 rad (it swings by 0.25 rad to either side), ' \
           'joint_2 at -1.6 rad (it swings by 0.2 rad' in capsys.readouterr().out
    found = read_log(str(log), load_robot(str(arm)))
    assert not found.notes
    np.testing.assert_allclose(found.joint[0], [0.7, -1.6], atol=1e-3)
    # Half of the way to the limits, so that a real drive may turn twice as far.
    np.testing.assert_allclose(np.abs(found.joint - found.joint[0]).max(axis=0), [0.25, 0.2],
                               rtol=0.2)


def test_a_move_about_zero_begins_there(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm = limited(tmp_path, 'reference', '[-0.5, 3.0]', '[-2.0, 2.0]')
    free, move = standard_move(load_robot('reference')), standard_move(load_robot(str(arm)))
    np.testing.assert_array_equal(move.commands, free.commands)
    assert main(['move', str(arm), '--strokes', '2', '--output', str(tmp_path / 'log.csv')]) == 0
    assert 'begin at rest, with joint_1 at 0 rad (it swings by 0.25 rad' in capsys.readouterr().out


def test_a_move_without_room_is_refused_in_one_line(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = '--strokes', '2', '--output', str(tmp_path / 'log.csv')
    arm = limited(tmp_path, 'reference', '[-1.5, 1.5]', '[0.1, 0.65]')
    assert main(['move', str(arm), *options]) == 2
    assert capsys.readouterr().err == (
        f'error: {arm}: drives.elbow.angle_limits_rad: expected at least 0.6 rad between them, '
        'a swing of 0.3 rad and as much for safety, got 0.55\n')
    # It is checked how well such an arm would tell its payload.
    assert main(['check', str(arm), '--modes', '1']) == 0
    assert 'a log of 10 strokes of 0.5 and 0.275 rad, 1 s each' in capsys.readouterr().out
    limited(tmp_path, 'reference', '[-1.5, 1.5]', '[0.1, 0.7]')
    assert main(['move', str(arm), *options]) == 0


def test_a_move_that_takes_the_simulated_arm_too_far_is_refused(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm = limited(tmp_path, 'reference', '[-0.5, 0.5]', '[-2.0, 2.0]', (
        'effects:\n- {name: actuator_gain, site: joint_1, factor: 2.5}\n'))
    options = '--strokes', '2', '--output', str(tmp_path / 'log.csv')
    assert main(['move', str(arm), *options]) == 2
    assert f'error: {arm}: drives.shoulder.angle_limits_rad: expected a simulated move within ' \
           '-0.5 to 0.5 rad, got ' in capsys.readouterr().err


def test_a_payload_that_the_model_cannot_move_is_named(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm = limited(tmp_path, 'reference', '[-1.5, 1.5]', '[-2.0, 2.0]')
    told = ['--payload', '1000', '--modes', '3']
    for command in (['check', str(arm)],
                    ['move', str(arm), '--strokes', '6', '--output', str(tmp_path / 'log.csv')]):
        assert main([*command, *told]) == 2
        assert capsys.readouterr().err == (
            f'error: {arm}: payload: expected one that the model moves, got 1000 kg: with 3 modes '
            'it is unstable\n')
    assert not (tmp_path / 'log.csv').exists()
