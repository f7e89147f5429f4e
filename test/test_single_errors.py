"""Numbers of a record that the rest of it contradicts: found, and none where there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

from attack.run import good_log, ROBOT
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.inputs.single_errors import single_errors
from flex_plant_sim.logs.csv_log import read_csv, write_csv
from flex_plant_sim.logs.log import Log
from flex_plant_sim.logs.read import read_log
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import simulate, Simulator
from flex_plant_sim.tools.log_input import hints
import numpy as np
import pytest

good = cache(good_log)


def spoilt(column: int, row: int, share: float) -> tuple[Array, Array, float]:
    """Return commands and outputs of a record in which one number is off, and by how much."""
    log = good()
    values = np.hstack([log.command, log.output])
    off = share * float(np.ptp(values[:, column]))
    values[row, column] += off
    return values[:, :2], values[:, 2:], off


@pytest.mark.parametrize('column', range(8))
@pytest.mark.parametrize('row, share', [(20, 0.2), (75, -0.4), (130, 1.0)])
def test_one_wrong_number_is_found_where_it_is(column: int, row: int, share: float) -> None:
    command, output, off = spoilt(column, row, share)
    found = single_errors(command, output)
    assert [(error.row, error.column) for error in found] == [(row, column)]
    assert found[0].error == pytest.approx(off, rel=0.3)


@pytest.mark.parametrize('column', range(2, 8))
def test_a_wrong_number_in_the_last_row_is_found(column: int) -> None:
    """Nothing comes after it that could contradict it; what came before does."""
    command, output, off = spoilt(column, 149, -0.3)
    found = single_errors(command, output)
    assert [(error.row, error.column) for error in found] == [(149, column)]
    assert found[0].error == pytest.approx(off, rel=0.3)


@pytest.mark.parametrize('column', [2, 3])
@pytest.mark.parametrize('row, share', [(20, 0.2), (75, -0.4), (130, 0.05)])
def test_a_sensor_that_slips_is_told_from_one_wrong_number(
        column: int, row: int, share: float) -> None:
    log = good()
    output, off = log.output.copy(), share * float(np.ptp(log.output[:, column - 2]))
    output[row:, column - 2] += off
    found = single_errors(log.command, output)
    assert [(error.row, error.column, error.lasting) for error in found] == [(row, column, True)]
    assert found[0].error == pytest.approx(off, rel=0.3)


def exchange(log: Log) -> Log:
    command, joint = log.command.copy(), log.joint.copy()
    command[:, 1], joint[:, 0] = log.joint[:, 0], log.command[:, 1]
    return replace(log, command=command, joint=joint)


@pytest.mark.parametrize('spoil', [exchange, lambda log: replace(
    log, command=log.command * [1.0, 1e-3])], ids=['columns exchanged', 'command in thousands'])
def test_a_joint_that_does_not_follow_its_command_is_named(spoil: Callable[[Log], Log]) -> None:
    assert not hints(good(), ROBOT)
    said = hints(spoil(good()), ROBOT)
    assert any(line.startswith('joint_2: hardly moves as the model expects') for line in said)


@pytest.mark.parametrize('lost', [(0,), (0, 1)])
def test_a_command_that_was_not_logged_is_named(lost: tuple[int, ...]) -> None:
    log = good()
    log.command[:, lost] = 0.0
    said = hints(log, ROBOT)
    assert [line[:13] for line in said] == [f'joint_{k + 1} turns' for k in lost]
    assert all('its command never changes' in line for line in said)


@pytest.mark.parametrize('noise', [0.0, 1.0])
@pytest.mark.parametrize('name', ['reference', 'quanser_2dsfl'])
@pytest.mark.parametrize('kind', ['step', 'square', 'pulse', 'sines'])
def test_what_the_arm_answers_to_is_no_error(kind: str, name: str, noise: float) -> None:
    robot = load_robot(name)
    k, amplitude = np.arange(400.0)[:, None], 1.0 if name == 'reference' else 0.3
    command = amplitude * {
        'step': (k > [120.0, 250.0]) * 1.0, 'square': np.sign(np.sin(k / [13.0, 21.0])),
        'pulse': (k == [133.0, 201.0]) * 1.0, 'sines': np.sin(k / [7.0, 11.0])}[kind]
    output, _ = simulate(Simulator(ExtendedArm(robot, 'assumed_modes', 2, 0.1)), command)
    scale = np.repeat([robot.angle_noise, robot.strain_noise], [2, output.shape[1] - 2])
    output = output + noise * scale * np.random.default_rng(3).standard_normal(output.shape)
    assert not single_errors(command, output)


def test_speeds_that_reverse_under_feedback_are_no_slip() -> None:
    """Feedback makes commands a line of the angles, from which reversed speeds are off at once."""
    robot = replace(load_robot('reference'), sample_time=0.004)
    simulator, noise = Simulator(ExtendedArm(robot, 'assumed_modes', 3, 0.2)), np.repeat(
        [robot.angle_noise, robot.strain_noise], [2, 4])
    rng, desired = np.random.default_rng(0), np.zeros(2)
    commands, outputs = np.zeros((1500, 2)), np.zeros((1500, 6))
    for k in range(1500):
        speed = 0.5 * np.sign(np.sin(2.0 * np.pi * 0.004 * k / 2.3 + np.r_[0.0, np.pi]))
        desired = desired + 0.004 * speed
        outputs[k] = simulator.measure().output + noise * rng.standard_normal(6)
        commands[k] = speed + 2.0 * (desired - outputs[k, :2])
        simulator.step(commands[k])
    assert single_errors(commands, outputs) == []


def test_records_of_other_arms_have_none(shared_data: Path) -> None:
    files = [*sorted((shared_data / 'bench').glob('*.csv')),
             shared_data / 'quanser_2dsfl' / 'square_10s.csv']
    assert len(files) == 9
    for file in files:
        robot = load_robot('reference' if file.parent.name == 'bench' else 'quanser_2dsfl')
        log = read_log(file, robot)
        assert not single_errors(log.command, log.output), file.name
        assert not [line for line in hints(log, robot) if 'hardly' in line], file.name


def test_a_log_says_where_and_what_would_fit(tmp_path: Path) -> None:
    log = good_log()
    log.command[70, 1] += 0.7
    was = log.command[70, 1]
    log.joint[100:, 0] += 0.2
    write_csv(tmp_path / 'log.csv', log)
    slip, note = read_csv(tmp_path / 'log.csv', ROBOT).notes
    assert slip.startswith('joint_1 steps by 0.2') and ' at line 102, ' in slip
    assert f'first line 72: command_2: {was:.6g}, where ' in note
    assert float(note.split('where ')[1].split()[0]) == pytest.approx(was - 0.7, abs=0.15)
