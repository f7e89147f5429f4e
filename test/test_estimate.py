"""flex_estimate: the payload that a log tells."""

from __future__ import annotations

from dataclasses import replace
import json
import math
from pathlib import Path
from typing import Any

from flex_payload_estimator.control.loop import run_loop
from flex_payload_estimator.control.lqg import LQGController, LQGSettings
from flex_payload_estimator.control.set_points import square
from flex_payload_estimator.estimators.base import Event
from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.tools import estimate
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.logs.bag_log import write_bag
from flex_plant_sim.logs.csv_log import write_csv
from flex_plant_sim.logs.log import Log
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Noise, Simulator
import numpy as np
import pytest

ROBOT = load_robot('reference')
SF1 = ('--estimator', 'sf1', '--model', 'paper_reduced', '--modes', '2')


@pytest.fixture(scope='module')
def run() -> Any:
    """Return an offline run of 3.5 s with 0.15 kg."""
    simulator = Simulator(ExtendedArm(ROBOT, 'paper_reduced', 2, 0.15), noise=Noise(2e-4, 5e-7),
                          seed=2)
    controller = LQGController(ROBOT, 'paper_reduced', 2, LQGSettings(
        integrator=False, command_limit=math.inf))
    return run_loop(simulator, make_estimator('sf1', ROBOT, 'paper_reduced', 2),
                    controller, square(), 3.5)


@pytest.fixture(scope='module')
def logs(run: Any, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return the run as CSV and as a bag whose time does not start at zero."""
    folder = tmp_path_factory.mktemp('logs')
    log = Log('run', run.time + 17.0, run.command, run.output[:, :2], run.output[:, 2:],
              ROBOT.gauge_names)
    write_csv(folder / 'run.csv', log)
    write_bag(folder / 'run_mcap', log)
    return folder / 'run.csv', folder / 'run_mcap'


def test_a_log_gives_the_loop_s_own_estimate(
    run: Any, logs: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    for path, digits in zip(logs, (1e-5, 1e-12)):
        assert estimate.main([str(path), *SF1, '--json', str(tmp_path / 'out.json')]) == 0
        result = json.loads((tmp_path / 'out.json').read_text())
        std = np.sqrt(run.variance[-1])
        assert result['mass_kg'] == pytest.approx(run.mass[-1], abs=digits)
        assert result['std_kg'] == pytest.approx(std, abs=digits)
        assert result['at_s'].keys() == {'1', '3'}
        assert result['at_s']['1'] == pytest.approx(run.mass[100], abs=digits)
        assert result['at_s']['3'] == pytest.approx(run.mass[300], abs=digits)
        low, high = result['interval95_kg']
        assert (high - low) / (2.0 * 1.96 * std) == pytest.approx(1.0, rel=1e-3)
        assert low < 0.15 < high
    table = capsys.readouterr().out
    for text in ('1 s', '3 s', 'end, 3.5 s', '95 % interval', '± one standard deviation'):
        assert text in table


def test_several_logs_stand_in_one_list(
    logs: tuple[Path, Path], tmp_path: Path,
) -> None:
    assert estimate.main([*map(str, logs), *SF1, '--json', str(tmp_path / 'out.json')]) == 0
    result = json.loads((tmp_path / 'out.json').read_text())
    assert [item['log'] for item in result['logs']] == [str(path) for path in logs]
    assert 'mass_kg' not in result, 'whose would it be?'
    one, other = (item['mass_kg'] for item in result['logs'])
    assert one == pytest.approx(other, abs=1e-5)


def test_a_bad_log_costs_none_of_the_others(
    logs: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    read = [str(tmp_path / 'absent.csv'), str(logs[0]), str(tmp_path / 'gone.csv')]
    assert estimate.main([*read, *SF1, '--json', str(tmp_path / 'out.json')]) == 2
    shown = capsys.readouterr()
    assert 'end, 3.5 s' in shown.out
    last = shown.err.splitlines()[-1]
    assert last.startswith('error: ') and 'absent.csv: expected' in last and 'gone.csv' in last
    result = json.loads((tmp_path / 'out.json').read_text())
    assert [item['log'] for item in result['logs']] == read[1:2] and 'mass_kg' not in result


def test_the_log_s_sample_time_wins(tmp_path: Path) -> None:
    time = np.linspace(0.0, 0.796, 200)
    log = Log('slow', time, np.zeros((200, 2)), np.zeros((200, 2)), np.zeros((200, 4)),
              ROBOT.gauge_names)
    write_csv(tmp_path / 'slow.csv', log)
    found = estimate.estimate_file(str(tmp_path / 'slow.csv'), ROBOT, 'sf1', 'paper_reduced', 2)
    assert found.time[-1] == pytest.approx(0.796)
    assert set(found.status) == {'not_excited'}


def test_changes_and_the_end_of_the_range_are_said(
        logs: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = estimate.Estimates('drop.csv', np.array([0.0, 1.0]), np.array([0.3, 0.1]),
                               np.array([1e-4, 1e-4]), ('ok', 'ok'), (False, False), 0.11,
                               (Event(0.5, 0.6, 0.3, 0.1),))
    assert 'change, 0.50 s   0.3 -> 0.1 kg' in found.table()
    assert 'It reaches the largest payload that is looked for, 0.11 kg' in found.table()
    assert found.results()['changes'] == [{'time_s': 0.5, 'before_kg': 0.3, 'after_kg': 0.1}]
    # The payload is 0.15 kg.
    assert estimate.main([str(logs[0]), *SF1, '--payload-max', '0.12']) == 0
    assert 'the largest payload that is looked for, 0.12 kg' in capsys.readouterr().out
    with pytest.raises(SystemExit):
        estimate.main([str(logs[0]), '--payload-max', '1e-30'])
    assert "--payload-max: expected a number from 1e-09 to 1000 kg, or 0, got '1e-30'" \
        in capsys.readouterr().err


def test_each_row_says_whether_it_holds_only_for_parts_as_told() -> None:
    time = np.array([0.0, 1.0, 3.0, 3.5])
    found = estimate.Estimates('log.csv', time, np.full(4, 0.1), np.full(4, 1e-6), ('ok',) * 4,
                               (False, True, False, False), 0.7)
    rows = found.table().splitlines()
    assert [row.endswith(' *') for row in rows[1:4]] == [True, False, False]
    assert rows[-1] == '  * if every part is as the robot file says'
    assert not any('robot file' in row for row in rows[:-1])
    assert found.results()['parts_as_told_at_s'] == {'1': True, '3': False}
    assert found.results()['parts_as_told'] is False
    assert '*' not in replace(found, parts_as_told=(False,) * 4).table()


def test_a_row_keeps_the_mode_of_its_time() -> None:
    """The lower link is 3 % stiffer than told, and `exact` is believed until that shows."""
    stiffer = ROBOT.with_link(1, youngs_modulus=1.03 * ROBOT.links[1].youngs_modulus)
    simulator = Simulator(ExtendedArm(stiffer, 'assumed_modes', 2, 0.1),
                          noise=Noise(2e-4, 5e-7), seed=2)
    estimator, command, rows = make_estimator('rpe', ROBOT, 'assumed_modes', 2), np.zeros(2), []
    for k in range(201):
        sample, command = simulator.measure(), np.full(2, 4.0 if k < 10 else 0.0)
        rows.append((sample.time, command, sample.output))
        simulator.step(command)
    times, commands, outputs = (np.array(column) for column in zip(*rows))
    log = Log('run', times, commands, outputs[:, :2], outputs[:, 2:], ROBOT.gauge_names)
    found = estimate.estimate(log, estimator)
    estimator.reset()
    applied = np.vstack([np.zeros(2), commands[:-1]])
    modes = []
    for t, output, one in zip(times, outputs, applied):
        estimator.update(t, output, one)
        modes.append(not estimator.incumbent.mode.free_parts)  # type: ignore[attr-defined]
    assert found.parts_as_told == tuple(modes) and len(set(modes)) == 2


def test_a_largest_payload_of_zero_is_the_estimator_s_as_in_the_node(
        logs: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in ((), ('--payload-max', '0')):
        assert estimate.main([str(logs[0]), *arguments]) == 0
    told, zero = capsys.readouterr().out.split('rpe: ')[1:]
    assert told == zero


def test_the_defaults_run_on_a_shared_record(shared_data: Path, tmp_path: Path) -> None:
    record = shared_data / 'bench' / 'case_8009d8b8.csv'
    assert estimate.main([str(record), '--json', str(tmp_path / 'out.json')]) == 0
    result = json.loads((tmp_path / 'out.json').read_text())
    truth = json.loads((shared_data / 'bench' / 'truth.json').read_text())[record.stem]
    low, high = result['interval95_kg']
    assert result['at_s'].keys() == {'1', '3', '10', '30'}
    assert result['at_s']['10'] == pytest.approx(truth['payload_true'], rel=0.03)
    assert low < truth['payload_true'] < high


@pytest.mark.parametrize(('arguments', 'text'), [
    (['missing.csv'], 'missing.csv: expected a log, the file does not exist'),
    (['{csv}', '--robot', 'quanser_2dsfl'], 'strain: expected 2 gauges'),
    (['{csv}', '--estimator', 'sf1_paper', '--model', 'paper'], 'paper_reduced'),
    (['{csv}', '--modes', '0'], "whole number from 1 to 20, got '0'"),
    (['{csv}', *SF1, '--json', 'no/such/out.json'], 'no/such'),
])
def test_bad_input_is_one_line_with_code_2_and_nothing_written(
    logs: tuple[Path, Path], arguments: list[str], text: str, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    try:
        code: Any = estimate.main([item.format(csv=logs[0]) for item in arguments])
    except SystemExit as exit_:
        code = exit_.code
    error = capsys.readouterr().err
    assert code == 2
    assert text in error
    # What the reader noticed in the log may stand before it.
    lines = error.splitlines()
    assert [line for line in lines if line.startswith('error: ')] == lines[-1:]
    assert list(tmp_path.iterdir()) == []
