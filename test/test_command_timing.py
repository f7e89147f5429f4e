"""Commands that are logged late, on arms of finite elements; the mistake is made by hand."""

from __future__ import annotations

from pathlib import Path

from flex_payload_estimator.tools.diagnose import main
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.command_timing import rows_late, with_command_timing
from flex_plant_sim.diagnosis.verdict.results import Diagnosis
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base, slowest_frequency
from flex_plant_sim.effects import catalogue
import numpy as np
import pytest
from simulated_records import effects as hidden
from simulated_records import REFERENCE, simulated, write
from truth.effects.hidden_effect import Parameters
from truth.records import make_record, TruthCase
from truth.records import Record as TrueRecord

ROBOT = load_robot('reference')
LAG: tuple[str, Parameters] = ('motor_lag', {'joint': 1, 'time_constant': 0.03})
DELAY: tuple[str, Parameters] = ('input_delay', {'delay': 0.01})
SOFT: tuple[str, Parameters] = ('link_stiffness', {'link': 1, 'factor': 1.25})
DRAG: tuple[str, Parameters] = ('viscous_friction', {'joint': 2, 'coefficient': 1.5})


def logged(rows: int, *effects: tuple[str, Parameters]) -> TrueRecord:
    """Return the log of an arm whose commands are written so many rows too late."""
    made = make_record(TruthCase(97, effects, duration_s=14.0))
    late = np.roll(made.command, rows, axis=0)
    kept = slice(abs(rows), len(late) - abs(rows))
    return TrueRecord(made.time[kept], late[kept], made.joint[kept], made.strain[kept],
                      made.columns)


def alone(made: TrueRecord, misread: bool = False) -> tuple[RefinedFit, Data]:
    """Return the set without causes, fitted to a log, and its data."""
    base = nominal_base(ROBOT, 'assumed_modes', 2)
    record = Record('log', made.time - made.time[0], made.command,
                    np.hstack([made.joint, made.strain]), 0.1, misread=misread)
    data = Data.of([record], slowest_frequency(base, 0.1), ROBOT.sample_time)
    return RefinedFit.refine(CandidateSet((), (np.zeros(0),)), base, data), data


def only(*names: str) -> list[str]:
    """Return options that leave these effects of the catalogue."""
    return ['--payload=0.1', '--jobs=1', '--modes=2',
            *(f'--exclude={name}' for name in catalogue() if name not in names)]


@pytest.mark.parametrize('rows, effects, found', [
    (1, (), 1), (3, (), 3), (0, (), 0), (-1, (), 0), (1, (DRAG,), 1), (0, (DRAG,), 0),
    (0, (LAG,), 0), (0, (DELAY,), 0), (0, (SOFT,), 0)])
def test_late_commands_are_told_from_clean_ones_and_from_late_drives(
        rows: int, effects: tuple[tuple[str, Parameters], ...], found: int) -> None:
    late, gain = rows_late(*alone(logged(rows, *effects)))
    assert late == found
    # More than the price of an input delay, exp(-4.0) in docs/evidence.md.
    assert gain > 4.0 if found else gain == 0.0


@pytest.mark.parametrize('misread', [False, True])
def test_commands_are_not_judged_by_channels_that_look_exchanged(misread: bool) -> None:
    said = with_command_timing(Diagnosis('nothing_wrong', ''), *alone(logged(1), misread))
    assert ('logged 10 ms late' in said.sentence) != misread


@pytest.mark.parametrize('rows, words', [
    (1, 'The commands seem to be logged 10 ms late: moved up by as much'),
    (-1, 'ms too early would look the same')])
def test_the_answer_says_that_the_log_may_be_wrong(
        rows: int, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    logged(rows).write_csv(tmp_path / 'log.csv')
    assert main([str(tmp_path / 'log.csv'), *only('input_delay')]) == 0
    assert words in capsys.readouterr().out


def test_late_commands_are_told_beside_what_was_found(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    logged(2, DRAG).write_csv(tmp_path / 'log.csv')
    assert main([str(tmp_path / 'log.csv'), *only(
        'viscous_friction', 'drive_bandwidth', 'input_delay')]) == 0
    assert 'The commands seem to be logged 20 ms late' in capsys.readouterr().out


def test_a_lost_payload_is_no_late_command(tmp_path: Path,
                                           capsys: pytest.CaptureFixture[str]) -> None:
    """Beside nothing, smooth commands moved by a row gain 9 nats, as they stand for it."""
    phase = np.pi * REFERENCE.sample_time * np.arange(1800.0)
    command = 0.6 * np.stack([np.sin(phase) + 0.5 * np.sin(1.7 * phase + 1.0),
                              np.sin(1.3 * phase + 0.5) + 0.5 * np.sin(2.3 * phase)], axis=1)
    lost = hidden('payload_change:arm:change_kg=-0.16,time_s=2.0')
    path = write(simulated(lost, 18.0, command=command), tmp_path / 'log.csv')
    assert main([str(path), *only('payload_change')]) == 0
    said = capsys.readouterr().out
    assert 'The payload changes' in said and 'seem to be logged' not in said
