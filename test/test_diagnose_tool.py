"""flex_diagnose as a user starts it: answers, files, one-line errors, Ctrl-C."""

from __future__ import annotations

from dataclasses import replace
from importlib import resources
from io import StringIO
import json
import os
from pathlib import Path
import pty
import re
import signal
import subprocess
import sys
import time
import warnings

from flex_payload_estimator.tools.diagnose import main, progress_bar
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.effects import catalogue, effects_of
from flex_plant_sim.tools.log_input import read_logs
from msg_config.errors import InputError
import numpy as np
import pytest
from simulated_records import effects, REFERENCE, simulated, write
from truth.effects.hidden_effect import Parameters
from truth.records import FINITE_ELEMENTS, make_record, TruthCase


class Terminal(StringIO):
    """What a process writes to a terminal."""

    def isatty(self) -> bool:
        """Tell that somebody watches."""
        return True


@pytest.fixture(scope='module')
def at_rest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a log in which nothing moves."""
    record = simulated(duration=24.0)
    noise = np.random.default_rng(0).standard_normal(record.output.shape)
    still = replace(record, command=0.0 * record.command,
                    output=np.array([1e-4] * 2 + [5e-7] * 4) * noise)
    return write(still, tmp_path_factory.mktemp('rest') / 'rest.csv')


def test_record_at_rest_is_refused_with_advice_and_its_files(
        at_rest: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    places = {name: str(tmp_path / name) for name in ('robot.yaml', 'answer.json')}
    code = main([str(at_rest), '--extended', places['robot.yaml'],
                 '--json', places['answer.json'], '--jobs', '1', '--payload', '0.1'])
    out, err = capsys.readouterr()
    assert (code, err) == (0, '')
    assert 'cannot answer' in out and places['robot.yaml'] in out
    found = json.loads(Path(places['answer.json']).read_text(encoding='utf-8'))
    assert (found['verdict'], found['causes']) == ('data_cannot_answer', [])
    assert found['advice']
    assert set(found['gain']) == set(REFERENCE.output_names)
    assert found['settings']['payload_told_kg'] == 0.1
    robot = load_robot(places['robot.yaml'])
    assert replace(robot, effects=()) == REFERENCE
    assert [effect.identifier for effect in effects_of(robot)] == [
        'foreshortening', 'coriolis_centripetal']
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(places)


def test_record_of_zeros_is_refused_in_the_same_words(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record = simulated(duration=24.0)
    path = write(replace(record, command=0.0 * record.command, output=0.0 * record.output),
                 tmp_path / 'zeros.csv')
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        assert main([str(path), '--jobs', '1', '--report', str(tmp_path / 'report'),
                     '--json', str(tmp_path / 'answer.json')]) == 0
    out, err = capsys.readouterr()
    assert 'joint_1 and joint_2 and the links hardly moved' in out and err == ''
    assert json.loads((tmp_path / 'answer.json').read_text())['verdict'] == 'data_cannot_answer'
    assert (tmp_path / 'report' / 'report.html').is_file()


def test_an_arm_without_gauges_is_diagnosed_by_its_joints(tmp_path: Path) -> None:
    """Friction is hidden in an arm of finite elements."""
    text = (resources.files('flex_plant_sim') / 'robots' / 'reference.yaml').read_text()
    robot, log, answer = (tmp_path / name for name in ('robot.yaml', 'log.csv', 'answer.json'))
    robot.write_text(re.sub('gauge_positions_m: .*', 'gauge_positions_m: []', text))
    hidden: tuple[str, Parameters] = ('viscous_friction', {'joint': 2, 'coefficient': 3.0})
    made = make_record(TruthCase(95, (hidden,), duration_s=14.0, simulator=FINITE_ELEMENTS))
    columns = ['time', 'command_1', 'command_2', 'joint_1', 'joint_2']
    np.savetxt(log, np.column_stack([made.time, made.command, made.joint]), delimiter=',',
               header=','.join(columns), comments='')
    asked = ('viscous_friction', 'coulomb_friction', 'actuator_bias', 'payload_mass')
    assert main([str(log), '--robot', str(robot), '--payload', '0.1', '--json', str(answer),
                 '--jobs', '1', *(f'--exclude={n}' for n in catalogue() if n not in asked)]) == 0
    found = json.loads(answer.read_text(encoding='utf-8'))
    cause, = found['causes']
    assert (cause['name'], cause['site']) == ('viscous_friction', 'joint_2')
    assert set(found['gain']) == {'joint_1', 'joint_2'}


@pytest.mark.parametrize('arguments, message', [
    (['missing.csv'], 'missing.csv: expected a log, the file does not exist'),
    (['LOG', '--robot', 'quanser_2dsfl'], 'strain: expected 2 gauges'),
    (['LOG', '--robot', 'none.yaml'], 'robot: expected one of'),
    (['LOG', '--json', 'no/such/folder.json'], 'no/such/folder.json: expected an existing'),
    (['LOG', '--report', 'no/such/folder'], 'no/such/folder: expected an existing folder'),
    (['LOG', '--jobs', '0'], 'argument --jobs: expected a whole number from 1 to 1000'),
    (['LOG', '--jobs', '9' * 5000], 'argument --jobs: expected a whole number from 1 to 1000'),
    (['LOG', '--seed', '-1'], 'argument --seed: expected a whole number from 0 to 2^32 - 1, got'),
    (['LOG', '--payload', '1e300'], 'argument --payload: expected a mass >= 0 kg, at most 1000'),
    (['LOG', '--payload', '-1'], 'argument --payload: expected a mass >= 0 kg'),
    (['LOG', '--true-payload', '0'], '--true-payload: expected a mass > 0 kg, got 0'),
    (['LOG', '--model', 'paper_reduced'], '--model: expected assumed_modes or paper'),
    (['LOG', '--payload', '0.1', '--pay', '0.3'], 'argument --payload: expected once, given'),
    (['LOG', '--model', 'paper', '--no-coriolis'], '--no-coriolis: expected a model with forces'),
    (['LOG', '--exclude', 'rust'], 'argument --exclude: invalid choice'),
    ([], 'the following arguments are required: LOG')])
def test_bad_input_is_one_line_and_code_2(
        arguments: list[str], message: str, at_rest: Path, tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    try:
        code = main([str(at_rest) if a == 'LOG' else a for a in arguments])
    except SystemExit as stop:
        code = int(stop.code or 0)
    out, err = capsys.readouterr()
    assert (code, out) == (2, '')
    assert message in err and len(err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_short_log_says_what_it_needs(tmp_path: Path,
                                      capsys: pytest.CaptureFixture[str]) -> None:
    path = write(simulated(duration=12.0), tmp_path / 'short.csv')
    assert main([str(path), '--json', str(tmp_path / 'a.json')]) == 2
    err = capsys.readouterr().err
    needed = re.search(r'short.csv: expected at least ([0-9.]+) s, 16 periods', err)
    assert needed and 12.3 < float(needed[1]) < 13.0 and len(err.splitlines()) == 1
    assert [item.name for item in tmp_path.iterdir()] == ['short.csv']


def test_logs_must_be_sampled_alike(at_rest: Path, tmp_path: Path) -> None:
    record = simulated(duration=8.0)
    other = write(replace(record, time=1.02 * record.time), tmp_path / 'other.csv')
    with pytest.raises(InputError, match=r'other.csv: expected a sample time of 0.01 s'):
        read_logs([str(at_rest), str(other)], REFERENCE, 'assumed_modes', 3)


def test_progress_bar_is_silent_where_nobody_watches(
        capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bar() as progress:
        for share in (0.0, 0.5, 0.4, 1.0):
            progress('fitting', share)
    assert capsys.readouterr() == ('', '')


def test_a_terminal_is_told_of_every_step_when_it_begins(monkeypatch: pytest.MonkeyPatch
                                                         ) -> None:
    """A step without progress, as the search has many, was not told at all."""
    monkeypatch.setattr(sys, 'stderr', terminal := Terminal())
    with progress_bar() as progress:
        for label in ('cause 1', 'laws', 'detection limits'):
            progress(label, 0.5)
            assert terminal.getvalue().split('\r')[-1].startswith(label)


def test_a_terminal_that_states_no_columns_is_told_too() -> None:
    master, slave = pty.openpty()  # Of no columns, as in some containers.
    subprocess.run([sys.executable, '-c', (
        'from flex_payload_estimator.tools.diagnose import progress_bar\n'
        'with progress_bar() as progress:\n    progress("a step", 0.5)')],
        stdin=slave, stdout=slave, stderr=slave, check=True)
    os.set_blocking(master, False)
    assert b'a step' in os.read(master, 10_000)
    os.close(slave)
    os.close(master)


def test_interrupt_leaves_nothing_behind(tmp_path: Path) -> None:
    """Ctrl-C reaches the whole process group while fits run in parallel."""
    record = simulated(effects('coulomb_friction:joint_2:level_n_m=0.5'), 16.0)
    log = write(record, tmp_path / 'log.csv')
    places = [str(tmp_path / name) for name in ('answer.json', 'robot.yaml', 'report')]
    run = subprocess.Popen(
        [sys.executable, '-m', 'flex_payload_estimator.tools.diagnose', str(log), '--jobs', '2',
         '--json', places[0], '--extended', places[1], '--report', places[2]],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        _wait_for_children(run)
        os.killpg(run.pid, signal.SIGINT)
        out, err = run.communicate(timeout=60.0)
    finally:
        if run.poll() is None:
            os.killpg(run.pid, signal.SIGKILL)
    assert (run.returncode, out) == (130, '')
    assert err.splitlines()[-1] == 'interrupted'
    assert [item.name for item in tmp_path.iterdir()] == ['log.csv']


def _wait_for_children(run: subprocess.Popen[str]) -> None:
    """Wait until a process has started others, or has ended."""
    children = Path(f'/proc/{run.pid}/task/{run.pid}/children')
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline and run.poll() is None:
        if children.read_text().split():
            return
        time.sleep(0.05)


@pytest.mark.parametrize('module', ['flex_plant_sim.tools', 'msg_config.node_start'])
def test_linear_algebra_keeps_to_one_thread_unless_told_otherwise(module: str) -> None:
    program = (f'import {module}, os, sys; '
               "print(os.environ['OPENBLAS_NUM_THREADS'], 'numpy' in sys.modules)")
    for told, expected in ((None, '1 False'), ('3', '3 False')):
        environment = {k: v for k, v in os.environ.items() if k != 'OPENBLAS_NUM_THREADS'}
        environment |= {'OPENBLAS_NUM_THREADS': told} if told else {}
        done = subprocess.run([sys.executable, '-c', program], env=environment,
                              capture_output=True, text=True, check=True)
        assert done.stdout.split('\n')[0] == expected
