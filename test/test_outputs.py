"""Outputs never replace an input, nor anything that the tools did not write."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import hashlib
import json
import os
from pathlib import Path
import resource
import subprocess
import sys

from flex_payload_estimator.tools import demo, diagnose, estimate, figures
from flex_plant_sim.arm.robot_file import load_robot, robot_text
from flex_plant_sim.atomic_file import MARK, whole_file, written_here
from flex_plant_sim.diagnosis.report import html_report
from flex_plant_sim.diagnosis.report.extended_file import write_extended
from flex_plant_sim.logs.bag_log import write_bag
from flex_plant_sim.logs.csv_log import write_csv
from flex_plant_sim.logs.log import Log
from flex_plant_sim.tools import replay, robot
from flex_plant_sim.tools.outputs import results
from msg_config.errors import InputError
import numpy as np
import pytest

ROBOT = load_robot('reference')
# Every tool with an output: its main, what it reads, and the option.
FILES = [
    (replay.main, ['{log}', '--robot', '{robot}'], '--json', 'out.json'),
    (replay.main, ['{log}', '--robot', '{robot}'], '--plot', 'out.png'),
    (replay.main, ['{bag}', '--robot', '{robot}'], '--json', 'out.json'),
    (estimate.main, ['{log}', '--robot', '{robot}'], '--json', 'out.json'),
    (diagnose.main, ['{log}', '--robot', '{robot}'], '--json', 'out.json'),
    (diagnose.main, ['{log}', '--robot', '{robot}'], '--extended', 'out.yaml'),
    (robot.main, ['template'], '--output', 'out.yaml'),
    (robot.main, ['check', '{robot}'], '--json', 'out.json'),
    (robot.main, ['show', '{robot}'], '--output', 'out.png'),
    (robot.main, ['calibrate', '{log}', '--robot', '{robot}', '--payload', '0.1'], '--output',
     'out.yaml'),
]
FOLDERS = [
    (diagnose.main, ['{log}', '--robot', '{robot}'], '--report', 'report.html'),
    (demo.main, ['--duration', '0.1', '--robot', '{robot}'], '--out', 'summary.json'),
    (figures.main, [], '--out', 'figure_13.png'),
]
Tool = Callable[[list[str]], int]


def still_log() -> Log:
    time = 0.01 * np.arange(40.0)
    return Log('still', time, np.sin(np.outer(time, [9.0, 7.0])), np.zeros((40, 2)),
               np.zeros((40, 4)), ROBOT.gauge_names)


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """Return a folder with a log, a bag, a robot, and a user's own file and folder."""
    write_csv(tmp_path / 'log.csv', still_log())
    write_bag(tmp_path / 'bag', still_log())
    (tmp_path / 'arm.yaml').write_text(robot_text('reference'))
    (tmp_path / 'own.json').write_text('{"years": "of work"}')
    (tmp_path / 'own').mkdir()
    for name in ('summary.json', 'thesis.txt', 'report.html', 'figure_13.png'):
        (tmp_path / 'own' / name).write_text('{"years": "of work"}')
    os.link(tmp_path / 'log.csv', tmp_path / 'hard.csv')
    os.symlink(tmp_path / 'log.csv', tmp_path / 'soft.csv')
    os.symlink(tmp_path / 'own.json', tmp_path / 'soft.json')
    return tmp_path


def contents(folder: Path) -> dict[str, str]:
    return {str(path): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in folder.rglob('*') if path.is_file()}


def refused(tool: Tool, arguments: list[str], place: Path,
            capsys: pytest.CaptureFixture[str]) -> str:
    """Run a tool that must refuse before any work; return its line."""
    before = contents(place)
    names = {'log': place / 'log.csv', 'bag': place / 'bag', 'robot': place / 'arm.yaml'}
    assert tool([argument.format(**names) for argument in arguments]) == 2
    out, err = capsys.readouterr()
    assert out == '' and err.startswith('error: ') and err.count('\n') == 1, err
    assert contents(place) == before
    return err


@pytest.mark.parametrize('tool, arguments, option, name', FILES)
def test_a_file_replaces_nothing_of_the_user_s(
        tool: Tool, arguments: list[str], option: str, name: str, place: Path,
        capsys: pytest.CaptureFixture[str]) -> None:
    for target in ('log.csv', 'arm.yaml', 'hard.csv', 'soft.csv', 'own.json', 'soft.json', 'own',
                   'bag', 'bag/metadata.yaml', 'absent/out.json', '/dev/full', '/dev/stdout'):
        refused(tool, [*arguments, option, str(place / target)], place, capsys)


@pytest.mark.parametrize('tool, arguments, option, name', [
    # A picture's suffix is asked for first.
    *(case for case in FILES if not case[3].endswith('.png')), *FOLDERS])
def test_a_dash_is_no_output(
        tool: Tool, arguments: list[str], option: str, name: str, place: Path,
        monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(place)
    err = refused(tool, [*arguments, option, '-'], place, capsys)
    assert '-: expected the name of a file or folder' in err
    assert not (place / '-').exists()


@pytest.mark.parametrize('tool, arguments, option, name', FOLDERS)
def test_a_folder_replaces_nothing_of_the_user_s(
        tool: Tool, arguments: list[str], option: str, name: str, place: Path,
        capsys: pytest.CaptureFixture[str]) -> None:
    for target in ('own', 'bag', 'own.json', 'log.csv', 'absent/out'):
        if target not in ('bag', 'absent/out') or tool is not figures.main:  # no harm is done
            refused(tool, [*arguments, option, str(place / target)], place, capsys)


def test_no_robot_file_is_replaced_for_people_edit_it(
        place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_extended(place / 'calibrated.yaml', 'reference', ROBOT, [])
    for tool, arguments, option, name in FILES:
        if name == 'out.yaml':
            refused(tool, [*arguments, option, str(place / 'calibrated.yaml')], place, capsys)


def test_a_marked_summary_does_not_give_the_user_s_files_away(
        place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (place / 'own' / 'summary.json').write_text('{"written_by": "flex_payload"}')
    err = refused(demo.main, ['--duration', '0.1', '--out', str(place / 'own')], place, capsys)
    assert 'thesis.txt' in err or 'figure_13.png' in err


def test_two_outputs_are_two_places(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    err = refused(replay.main, ['{log}', '--json', str(place / 'a.png'), '--plot',
                                str(place / 'a.png')], place, capsys)
    assert 'expected another place than --plot' in err


@pytest.mark.parametrize('option', ['--extended', '--json'])
def test_a_report_is_no_place_for_another_output(
        place: Path, option: str, capsys: pytest.CaptureFixture[str]) -> None:
    (place / 'rep').mkdir()
    for output, report in (('new', 'new'), ('rep/report.html', 'rep')):
        err = refused(diagnose.main, ['{log}', option, str(place / output), '--report',
                                      str(place / report)], place, capsys)
        assert 'expected another place than --report' in err


def test_a_demo_does_not_replace_the_robot_that_it_reads(
        place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (place / 'run').mkdir()
    for name, text in (('summary.json', MARK), ('arm.yaml', robot_text('reference'))):
        (place / 'run' / name).write_text(text)
    err = refused(demo.main, ['--duration', '0.1', '--out', str(place / 'run'), '--robot',
                              str(place / 'run' / 'arm.yaml')], place, capsys)
    assert 'expected another place than the input' in err


def test_a_tool_replaces_what_it_wrote(place: Path) -> None:
    (place / 'out.json').touch()  # empty files are free
    for plot in ('out.png', 'out.svg'):
        assert replay.main([str(place / 'log.csv'), '--json', str(place / 'out.json'), '--plot',
                            str(place / plot)]) == 0
        assert written_here(place / plot)
    assert json.loads((place / 'out.json').read_text())['written_by'] == 'flex_payload'


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """Let no file grow beyond a size, bytes, inside the block."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_disk_that_fills_keeps_the_rest_and_leaves_nothing_half_written(
        place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The probe and the JSON fit, the picture does not."""
    with files_of_at_most(6000):
        code = replay.main([str(place / 'log.csv'), '--json', str(place / 'out.json'), '--plot',
                            str(place / 'out.png')])
    err = capsys.readouterr().err
    assert code == 2, err
    assert err.splitlines()[-1].startswith('error: ') and 'too large' in err
    assert json.loads((place / 'out.json').read_text())['channels']
    assert not (place / 'out.png').exists() and not list(place.glob('.*'))


@pytest.mark.parametrize('earlier', [False, True])
def test_a_disk_that_fills_leaves_no_folder_that_was_made_for_the_output(
        place: Path, earlier: bool, capsys: pytest.CaptureFixture[str]) -> None:
    folder = place / 'rep'
    if earlier:
        folder.mkdir()
    with files_of_at_most(6000):
        code = figures.main(['--out', str(folder)])
    err = capsys.readouterr().err
    assert code == 2 and 'too large' in err, err
    assert folder.exists() == earlier and not (earlier and list(folder.iterdir()))


def test_a_report_that_cannot_be_written_leaves_no_folder(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(html_report, 'render', lambda report: '\ud800')  # fails in writing
    with pytest.raises(UnicodeEncodeError):
        html_report.write_report(tmp_path / 'rep', None)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('where', ['full', 'closed pipe'])
def test_standard_output_that_fails_keeps_the_files(place: Path, where: str) -> None:
    with open('/dev/full' if where == 'full' else os.devnull, 'w') as full:
        run = subprocess.Popen(
            [sys.executable, '-m', 'flex_plant_sim.tools.replay', str(place / 'log.csv'),
             '--json', str(place / 'out.json')], text=True, stderr=subprocess.PIPE,
            stdout=full if where == 'full' else subprocess.PIPE)
        if run.stdout is not None:
            run.stdout.close()
        _, err = run.communicate(timeout=120)
    assert run.returncode == (75 if where == 'full' else 2), err
    assert err.startswith('error: standard output: ') and err.count('\n') == 1
    assert json.loads((place / 'out.json').read_text())['channels']


@pytest.mark.parametrize('encoding', ['ascii', 'latin-1'])
def test_a_terminal_that_knows_few_characters_gets_the_others_as_question_marks(
        encoding: str) -> None:
    run = subprocess.run(
        [sys.executable, '-m', 'flex_plant_sim.tools.robot', 'prior', 'reference'],
        env={**os.environ, 'PYTHONIOENCODING': encoding}, capture_output=True, timeout=120)
    assert (run.returncode, run.stderr) == (0, b'')
    assert ('?' if encoding == 'ascii' else '±').encode(encoding) in run.stdout


@pytest.mark.parametrize(('closed', 'logs'), [
    ('>&-', {'log.csv': 0}), ('2>&-', {'log.csv': 0}),
    ('<&- >&- 2>&-', {'log.csv': 0, 'absent.csv': 2})])
def test_closed_standard_streams_fail_no_tool(place: Path, closed: str, logs: dict[str, int]
                                              ) -> None:
    command = f'exec {sys.executable} -m flex_plant_sim.tools.replay log.csv --json out.json'
    for log, code in logs.items():
        run = subprocess.run(['sh', '-c', f'{command.replace("log.csv", log)} {closed}'],
                             cwd=place, timeout=120)
        assert run.returncode == code
    assert json.loads((place / 'out.json').read_text())['channels']


def test_a_name_of_any_bytes_is_read_and_drawn(place: Path) -> None:
    log = Path(os.fsdecode(os.fsencode(place) + b'/\xff.csv'))
    log.write_bytes((place / 'log.csv').read_bytes())
    assert replay.main([str(log), '--json', str(place / 'out.json'), '--plot',
                        str(place / 'out.svg')]) == 0
    assert json.loads((place / 'out.json').read_text())['log'].endswith('/ .csv')


@pytest.mark.skipif(os.geteuid() == 0, reason='root may write everywhere')
def test_a_read_only_folder_is_refused(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (place / 'fixed').mkdir(mode=0o500)
    refused(replay.main, ['{log}', '--json', str(place / 'fixed' / 'out.json')], place, capsys)


def test_an_output_that_fails_unforeseen_keeps_the_rest(
        capsys: pytest.CaptureFixture[str]) -> None:
    def fail(path: str) -> None:
        raise ValueError(path)

    with pytest.raises(ValueError, match='first'), results() as write:
        write(fail, 'first')
        write(fail, 'second')
        write(print, 'kept')
    assert capsys.readouterr().out == 'kept\n'


def test_a_file_without_the_mark_is_never_replaced(tmp_path: Path) -> None:
    (tmp_path / 'a').write_text('mine')
    with pytest.raises(InputError, match='a file that it did not write'), \
            whole_file(tmp_path / 'a') as new:
        new.write_text(MARK)
    assert (tmp_path / 'a').read_text() == 'mine'


def test_an_earlier_folder_comes_back_where_the_new_one_cannot_take_its_place(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails_onto(source: Path, target: Path) -> None:
        if Path(source).name == 'run' and Path(target) == tmp_path / 'run' and (
                Path(source) / 'new').exists():
            raise KeyboardInterrupt
        rename(source, target)

    with whole_file(tmp_path / 'run', folder=True) as first:
        first.mkdir()
        (first / 'summary.json').write_text(MARK)
    rename = os.replace
    monkeypatch.setattr(os, 'replace', fails_onto)
    with pytest.raises(KeyboardInterrupt), whole_file(tmp_path / 'run', folder=True) as second:
        second.mkdir()
        (second / 'new').touch()
    assert [path.name for path in tmp_path.iterdir()] == ['run']
    assert (tmp_path / 'run' / 'summary.json').read_text() == MARK
