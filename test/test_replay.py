"""Replay of logs: recovers what it simulated, says how wrong it is, and fails in one line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib import resources
import json
from pathlib import Path
import signal
import subprocess
import sys
import time

from flex_plant_sim.arm.robot import EffectSpec, Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.report.extended_file import write_extended
from flex_plant_sim.effects import build, effects_of
from flex_plant_sim.logs.csv_log import write_csv
from flex_plant_sim.logs.log import Log
from flex_plant_sim.logs.read import read_log
from flex_plant_sim.simulation.agreement import fit_percent, rmse
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.nominal import nominal_robot
from flex_plant_sim.simulation.replay import replay, start_rates
from flex_plant_sim.simulation.simulator import Noise, simulate, Simulator
from flex_plant_sim.tools import command_line
from flex_plant_sim.tools import replay as tool
from held_file import held
from msg_config.errors import InputError
import numpy as np
import pytest
import yaml

ROBOT = load_robot('reference')
TOLD = 0.12378423790934351  # truth.json, payload_told of case_8009d8b8


CORIOLIS = EffectSpec('coriolis_centripetal', 'arm', {'share': 1.0})


def simulated_log(robot: Robot = ROBOT, rows: int = 300, start: float = 0.4,
                  nature: tuple[EffectSpec, ...] = (CORIOLIS,), speed: float = 1.0) -> Log:
    """Return a log that the arm itself made, from joint angles `start` at rest."""
    time_ = robot.sample_time * np.arange(float(rows))
    command = speed * np.column_stack([np.sin(3.0 * time_), 0.7 * np.cos(2.0 * time_)])
    arm = ExtendedArm(robot, 'assumed_modes', 3,
                      effects=[build(spec, robot) for spec in (*robot.effects, *nature)])
    simulator = Simulator(arm)
    simulator.state[:2] = start
    output, _ = simulate(simulator, command)
    return Log('made', time_, command, output[:, :2], output[:, 2:], robot.gauge_names)


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, '-m', 'flex_plant_sim.tools.replay', *arguments],
                          capture_output=True, text=True)


def test_fit_and_rmse_by_hand() -> None:
    measured = np.array([[1.0, 5.0], [3.0, 5.0], [5.0, 5.0]])
    simulated = np.array([[1.0, 5.0], [2.0, 5.0], [5.0, 5.5]])
    fit = fit_percent(measured, simulated)
    assert fit[0] == pytest.approx(100.0 * (1.0 - 1.0 / np.sqrt(8.0)))
    assert np.isnan(fit[1])
    assert rmse(measured, simulated) == pytest.approx([np.sqrt(1.0 / 3.0), np.sqrt(0.25 / 3.0)])
    assert fit_percent(measured, measured.mean(axis=0) + 0.0 * measured)[0] == pytest.approx(0.0)


def test_replay_of_its_own_simulation_is_exact() -> None:
    result = replay(simulated_log(), ROBOT)
    np.testing.assert_allclose(result.fit_percent, 100.0, atol=1e-9)
    np.testing.assert_allclose(result.simulated, result.log.output, rtol=0.0, atol=1e-13)


def test_replay_applies_the_effects_of_the_robot_file() -> None:
    spec = EffectSpec('coulomb_friction', 'joint_2', {'level_n_m': 0.4})
    rubbing = replace(ROBOT, effects=(spec,))
    log = simulated_log(rubbing)
    np.testing.assert_allclose(replay(log, rubbing).fit_percent, 100.0, atol=1e-9)
    assert replay(log, ROBOT).fit_percent[1] < 99.0


@pytest.mark.parametrize('nature, arguments, words', [
    ((CORIOLIS,), [], 'reference, assumed_modes, 3 modes, with Coriolis forces'),
    ((), ['--no-coriolis'], 'reference, assumed_modes, 3 modes, without Coriolis forces'),
    ((), ['--model', 'paper'], 'reference, paper, 3 modes, without Coriolis forces')])
def test_tool_says_whether_coriolis_forces_act(
        nature: tuple[EffectSpec, ...], arguments: list[str], words: str, tmp_path: Path,
        capsys: pytest.CaptureFixture[str]) -> None:
    write_csv(tmp_path / 'log.csv', simulated_log(nature=nature))
    assert tool.main([str(tmp_path / 'log.csv'), *arguments]) == 0
    shown = capsys.readouterr()
    assert f'{words}, 0.1 kg' in shown.out and shown.err == ''
    assert ('paper' in arguments) or shown.out.count('fit 100.0 %') == 6


@pytest.mark.parametrize('arguments, why', [
    (['--model', 'paper'], '--model paper has none'),
    (['--robot', 'spinning.yaml'], 'the robot file spinning.yaml names these forces, which stay')])
def test_forces_that_cannot_be_left_out_are_told(
        arguments: list[str], why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    write_extended(tmp_path / 'spinning.yaml', 'reference', ROBOT, effects_of(
        nominal_robot(ROBOT)))
    write_csv(tmp_path / 'log.csv', simulated_log())
    assert tool.main(['log.csv', *arguments, '--no-coriolis']) == 2
    err = capsys.readouterr().err
    assert err.startswith('error: --no-coriolis: ') and why in err and err.count('\n') == 1
    assert tool.main(['log.csv', *arguments]) == 0


def test_a_log_faster_than_the_model_was_checked_for_is_said(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = simulated_log(speed=3.0)
    write_csv(tmp_path / 'log.csv', log)
    assert tool.main([str(tmp_path / 'log.csv')]) == 0
    error = capsys.readouterr().err
    fastest = np.abs(np.gradient(log.joint[:, 0], 0.01)).max()
    said = float(error.split('joint_1 turns at up to ')[1].split()[0])
    assert said == pytest.approx(fastest, rel=0.02)
    assert 'the models are checked up to 1.5 rad/s' in error and error.count('\n') == 1


def test_replay_takes_the_log_s_own_rate() -> None:
    robot = replace(ROBOT, sample_time=0.002)
    result = replay(simulated_log(robot), ROBOT)
    assert result.arm.robot.sample_time == 0.002
    np.testing.assert_allclose(result.fit_percent, 100.0, atol=1e-9)


def test_replay_starts_where_the_log_does() -> None:
    result = replay(simulated_log(start=-1.1), ROBOT)
    np.testing.assert_allclose(result.simulated[0, :2], -1.1, atol=1e-14)
    np.testing.assert_allclose(result.simulated[0, 2:], 0.0, atol=1e-18)


def test_clean_record_of_another_simulator(shared_data: Path) -> None:
    """`bench`, nothing hidden: joints >= 97 %, every gauge >= 85 %, three modes."""
    log = read_log(shared_data / 'bench' / 'case_8009d8b8.csv', ROBOT)
    modes = replay(log, ROBOT, 'assumed_modes', 3, TOLD).fit_percent
    assert np.all(modes[:2] >= 97.0)
    assert np.all(modes[2:] >= 85.0)
    paper = replay(log, ROBOT, 'paper', 2, TOLD).fit_percent
    assert np.all(paper[:2] >= 97.0)
    assert np.all(paper[2:] < modes[2:] - 20.0)


def test_real_record_shows_how_wrong_the_nominal_model_is(shared_data: Path) -> None:
    robot = load_robot('quanser_2dsfl')
    log = read_log(shared_data / 'quanser_2dsfl' / 'square_10s.csv', robot).part(0, 6000)
    result = replay(log, robot)
    assert np.all(np.isfinite(result.simulated))
    assert np.all(result.fit_percent < 50.0)


def test_tool_writes_what_it_prints(tmp_path: Path) -> None:
    write_csv(tmp_path / 'log.csv', simulated_log())
    out, plot = tmp_path / 'out.json', tmp_path / 'out.png'
    process = run(str(tmp_path / 'log.csv'), '--model', 'paper', '--modes', '2', '--payload',
                  '0.05', '--json', str(out), '--plot', str(plot))
    assert process.returncode == 0, process.stderr
    results = json.loads(out.read_text())
    assert (results['model'], results['modes'], results['payload_kg']) == ('paper', 2, 0.05)
    assert (results['samples'], results['sample_time_s']) == (300, 0.01)
    assert list(results['channels']) == ['joint_1', 'joint_2', *ROBOT.gauge_names]
    log = read_log(tmp_path / 'log.csv', ROBOT)
    expected = replay(log, ROBOT, 'paper', 2, 0.05)
    for k, (name, channel) in enumerate(results['channels'].items()):
        assert channel['fit_percent'] == pytest.approx(expected.fit_percent[k], abs=1e-9)
        assert channel['rmse'] == pytest.approx(expected.rmse[k], rel=1e-9)
        assert channel['unit'] == ('rad' if name.startswith('joint') else 'm/m')
        assert f'{name:<12}' in process.stdout
        assert f'fit {channel["fit_percent"]:.1f} %' in process.stdout
    assert plot.read_bytes().startswith(b'\x89PNG')


def test_channel_at_rest_has_no_fit(tmp_path: Path) -> None:
    log = simulated_log()
    still = replace(log, command=0.0 * log.command, joint=0.0 * log.joint + 0.1,
                    strain=0.0 * log.strain)
    write_csv(tmp_path / 'log.csv', still)
    process = run(str(tmp_path / 'log.csv'), '--json', str(tmp_path / 'out.json'))
    assert process.returncode == 0, process.stderr
    assert process.stdout.count('channel at rest') == 6
    channels = json.loads((tmp_path / 'out.json').read_text())['channels']
    assert all(channel['fit_percent'] is None for channel in channels.values())


def test_other_rate_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_csv(tmp_path / 'log.csv', simulated_log(replace(ROBOT, sample_time=0.005)))
    assert tool.main([str(tmp_path / 'log.csv')]) == 0
    assert 'sampled every 0.005 s, not 0.01 s as reference.yaml says; the log wins' \
        in capsys.readouterr().err


def test_an_unstable_arm_is_an_error_not_numbers() -> None:
    """No robot file is unstable, so this arm is made without one: its elbow drive pushes."""
    robot = ROBOT.with_drive(1, damping=-4.0)
    with pytest.raises(InputError) as error:
        replay(simulated_log(), robot)
    message = str(error.value)
    assert message.startswith('reference.yaml: the model assumed_modes with 3 modes and 0.1 kg '
                              'is unstable: ')
    assert 'fastest growing pole +' in message


def test_unstable_parameters_leave_no_file(tmp_path: Path) -> None:
    data = yaml.safe_load((resources.files('flex_plant_sim') / 'robots' / 'quanser_2dsfl.yaml')
                          .read_text())
    data['drives']['elbow']['damping_n_m_s'] = -1.5
    (tmp_path / 'robot.yaml').write_text(yaml.safe_dump(data))
    write_csv(tmp_path / 'log.csv', simulated_log())
    process = run(str(tmp_path / 'log.csv'), '--robot', str(tmp_path / 'robot.yaml'), '--json',
                  str(tmp_path / 'out.json'), '--plot', str(tmp_path / 'out.png'))
    assert process.returncode == 2
    assert process.stderr == (f'error: {tmp_path / "robot.yaml"}: drives.elbow.damping_n_m_s: '
                              'expected a number >= 0, got -1.5\n')
    assert not list(tmp_path.glob('out*'))


BAD_CALLS = [
    (['absent.csv'], 'error: absent.csv: expected a log, the file does not exist'),
    (['absent.csv', '--robot', 'scara'], 'error: robot: expected one of quanser_2dsfl, '),
    (['absent.csv', '--payload', '-0.1'], 'error: argument --payload: expected a mass >= 0 kg'),
    (['absent.csv', '--payload', 'nan'], 'error: argument --payload: expected a mass >= 0 kg'),
    (['absent.csv', '--modes', '0'], 'error: argument --modes: expected a whole number from 1'),
    (['absent.csv', '--model', 'rigid'], "error: argument --model: invalid choice: 'rigid'"),
    ([], 'error: the following arguments are required: LOG'),
    (['{log}', '--json', '{folder}/absent/out.json'], 'error: {folder}/absent/out.json: expected '
                                                      'an existing folder'),
    (['{log}', '--plot', '{folder}/out.docx'], 'error: {folder}/out.docx: expected an image '
                                               'suffix'),
    (['{log}', '--robot', 'quanser_2dsfl'], 'error: {log}: strain: expected 2 gauges'),
]


@pytest.mark.parametrize('arguments, message', BAD_CALLS)
def test_a_bad_call_is_one_line_and_exit_code_2(tmp_path: Path, arguments: list[str],
                                                message: str,
                                                capsys: pytest.CaptureFixture[str]) -> None:
    write_csv(tmp_path / 'log.csv', simulated_log())
    names = {'log': str(tmp_path / 'log.csv'), 'folder': str(tmp_path)}
    try:
        code = tool.main([argument.format(**names) for argument in arguments])
    except SystemExit as leaving:  # argparse leaves by itself
        code = int(leaving.code or 0)
    shown = capsys.readouterr().err
    assert code == 2
    assert shown.startswith(message.format(**names))
    assert shown.count('\n') == 1
    assert [path.name for path in tmp_path.iterdir()] == ['log.csv']


@contextmanager
def started(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen([sys.executable, '-m', 'flex_plant_sim.tools.replay', *arguments],
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_leaves_nothing_behind(tmp_path: Path, number: signal.Signals) -> None:
    """The log cannot be opened, so the tool is surely running when it comes."""
    log = tmp_path / 'log.csv'
    with held(log) as wait, started(str(log), '--json', str(tmp_path / 'out.json')) as process:
        wait()
        process.send_signal(number)
        _, error = process.communicate(timeout=60)
    assert (process.returncode, error) == (130, 'interrupted\n')
    assert [path.name for path in tmp_path.iterdir()] == ['log.csv']


def test_what_is_told_to_ignore_a_signal_does() -> None:
    """As nohup tells of a terminal that closes."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        assert command_line.run(lambda: signal.raise_signal(signal.SIGHUP)) == 0
    finally:
        signal.signal(signal.SIGHUP, before)


class Swallowing:
    """Something that hears a Ctrl-C while it is taken down, where Python raises nothing."""

    def __del__(self) -> None:
        """Hear it."""
        signal.raise_signal(signal.SIGINT)


def test_an_interrupt_that_a_destructor_swallows_comes_again(
        capsys: pytest.CaptureFixture[str]) -> None:
    def work() -> None:
        Swallowing()
        time.sleep(5.0)

    assert command_line.run(work) == 130
    assert capsys.readouterr().err == 'interrupted\n'


def test_a_log_that_begins_in_motion_is_simulated_in_motion(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot = load_robot('reference')
    simulator = Simulator(ExtendedArm(robot, 'assumed_modes', 2), noise=Noise(1e-4, 5e-7))
    t: Array = 0.01 * np.arange(400.0)
    commands = np.column_stack([np.sin(2.0 * t), 0.8 * np.cos(1.5 * t)])
    output, rates = simulate(simulator, commands)
    whole = Log('whole', t, commands, output[:, :2], output[:, 2:], robot.gauge_names)
    assert not start_rates(whole, ExtendedArm(robot)).any()
    cut = whole.part(250, 400)
    np.testing.assert_allclose(start_rates(cut, ExtendedArm(robot)), rates[250], atol=0.05)
    write_csv(tmp_path / 'cut.csv', cut)
    assert tool.main([str(tmp_path / 'cut.csv'), '--robot', 'reference', '--no-coriolis']) == 0
    assert 'cut.csv: begins in motion, at ' in capsys.readouterr().err
    assert replay(cut, robot, modes=2, coriolis=False).fit_percent[:2].min() > 97.0


def test_a_drive_that_follows_its_first_command_at_once_begins_at_rest() -> None:
    # The first commands of the demo's loop. By the angles joint 2 turns from the first row on.
    first = [(0.62, 1.49), (0.47, 1.19), (0.40, 0.54), (0.84, 0.33), (0.61, 0.33), (-0.04, 0.32),
             (-0.05, 0.32), (0.14, 0.30), (0.03, 0.36), (-0.10, 0.30), (0.0, 0.17), (0.02, 0.09)]
    robot, t = load_robot('reference'), 0.01 * np.arange(400.0)
    commands = np.column_stack([np.sin(2.0 * t), 0.8 * np.sin(1.5 * t)])
    commands[:len(first)] = first
    simulator = Simulator(ExtendedArm(robot, 'assumed_modes', 3), noise=Noise(2e-5, 5e-7))
    output, _ = simulate(simulator, commands)
    log = Log('loop', t, commands, output[:, :2], output[:, 2:], robot.gauge_names)
    assert start_rates(log, ExtendedArm(robot)).any()
    found = replay(log, robot, coriolis=False)
    assert not found.start_rates.any() and found.fit_percent.min() > 97.0
