"""flex_fleet over small logs: one row a log, whatever a log, a worker or a kill does."""

from __future__ import annotations

import csv
from importlib.metadata import version
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

from faults.fleet_run import killed_at_work
from flex_payload_estimator.fleet.folders import arm_of, logs_below, robot_of
from flex_payload_estimator.fleet.journal import Journal
from flex_payload_estimator.fleet.log_task import diagnose_and_weigh, LogTask, Row
from flex_payload_estimator.fleet.table import write_csv
from flex_payload_estimator.tools.fleet import main as fleet
from flex_payload_estimator.tools.fleet import options as fleet_options
from flex_payload_estimator.tools.fleet import run, tasks_of
from held_file import held
from msg_config.errors import InputError
import numpy as np
import psutil
import pytest

HEADER = 'time,command_1,command_2,joint_1,joint_2,strain_1a,strain_1b,strain_2a,strain_2b'
SAMPLES = 1300  # little more than the shortest that flex_diagnose takes
ANSWERS = ('arm', 'log', 'verdict', 'causes', 'payload_kg', 'since', 'error')


def _log_at_rest(path: Path, seed: int, samples: int = SAMPLES) -> None:
    rng = np.random.default_rng(seed)
    rows = np.zeros((samples, 9))
    rows[:, 0] = 0.01 * np.arange(samples)
    rows[:, 3:5] = rng.normal(0.0, 2e-4, (samples, 2))
    rows[:, 5:] = rng.normal(0.0, 5e-7, (samples, 4))
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, rows, fmt='%.9g', delimiter=',', header=HEADER, comments='')


def _fleet(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, '-m', 'flex_payload_estimator.tools.fleet', 'night', '--out', 'out',
         '--workers', '2', *arguments], cwd=folder, text=True, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE)


def _table(folder: Path) -> list[dict[str, str]]:
    with (folder / 'out' / 'fleet.csv').open(newline='') as file:
        return [{key: row[key] for key in ANSWERS} for row in csv.DictReader(file)]


def _kill_a_worker(fleet: subprocess.Popen[str]) -> None:
    """Kill a worker while it waits for a tool."""
    deadline = time.monotonic() + 300
    while time.monotonic() < deadline:
        if killed_at_work(fleet.pid):
            return
        time.sleep(0.02)
    raise AssertionError('no worker was seen at work')


@pytest.mark.slow
def test_a_bad_file_and_a_killed_worker_lose_nothing_else(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    night = tmp_path / 'night'
    _log_at_rest(night / 'arm_0' / 'rest.csv', 0)
    (night / 'arm_1').mkdir()
    (night / 'arm_1' / 'bad.csv').write_text('no,log\n1,2\n')
    running = _fleet(tmp_path)
    _kill_a_worker(running)
    output, errors = running.communicate(timeout=900)
    assert running.returncode == 0 and 'Traceback' not in errors, errors
    assert '2 logs of 2 arms, 1 with errors' in output
    rows = {Path(row['log']).name: row for row in _table(tmp_path)}
    # Noise alone gets no name.
    assert (rows['rest.csv']['verdict'], rows['rest.csv']['causes']) == ('data_cannot_answer', '')
    assert 'column time: missing, got no, log' in rows['bad.csv']['error']
    assert 'night/arm_1' in (tmp_path / 'out' / 'fleet.html').read_text()
    # Nothing is left to do: the same table, without a cluster.
    before = _table(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr('flex_payload_estimator.tools.fleet.cluster', None)
    assert fleet(['night', '--out', 'out', '--workers', '2']) == 0
    assert _table(tmp_path) == before
    journal = (tmp_path / 'out' / 'fleet.jsonl').read_text().splitlines()
    assert [len(json.loads(line)) for line in journal] == 2 * [3] + 3 * [2], 'rows, tables'


def test_a_log_without_end_is_given_up(tmp_path: Path) -> None:
    log = tmp_path / 'endless.csv'
    task = LogTask('a', str(log), 'reference', str(tmp_path / 'page'), timeout=1.0)
    with held(log):
        row = diagnose_and_weigh(task)
    assert row.error == 'estimate: given up after 1 s' and not row.verdict and row.again
    assert row.seconds < 2.0, 'both tools share the time'


def test_a_log_that_is_a_pipe_is_one_row(tmp_path: Path) -> None:
    (tmp_path / 'night').mkdir()
    os.mkfifo(tmp_path / 'night' / 'pipe.csv')
    (_, log), = logs_below([str(tmp_path / 'night')], tmp_path / 'out')
    row = diagnose_and_weigh(LogTask('a', str(log), 'reference', str(tmp_path / 'page')))
    assert row.error == 'diagnose: expected a file or a bag folder, got a FIFO' and not row.again


WORKER = """
import sys
from flex_payload_estimator.fleet.log_task import diagnose_and_weigh, LogTask
row = diagnose_and_weigh(LogTask('a', sys.argv[1], 'reference', sys.argv[2]))
print(row.again, row.error)
"""


@pytest.mark.parametrize('killed, number', [
    ('worker', signal.SIGKILL), ('tool', signal.SIGINT)])
def test_a_tool_ends_with_its_worker_and_a_killed_tool_is_the_last(
        killed: str, number: signal.Signals, tmp_path: Path) -> None:
    log = tmp_path / 'endless.csv'
    (tmp_path / 'tmp').mkdir()
    with held(log) as wait:
        worker = subprocess.Popen(
            [sys.executable, '-c', WORKER, str(log), str(tmp_path / 'page')], text=True,
            stdout=subprocess.PIPE, env={**os.environ, 'TMPDIR': str(tmp_path / 'tmp')})
        wait()
        tool, = psutil.Process(worker.pid).children()
        os.kill(worker.pid if killed == 'worker' else tool.pid, number)
        said, _ = worker.communicate(timeout=20)
        tool.wait(timeout=20)
    if killed == 'tool':
        assert said == 'True estimate: interrupted\n'
    assert [*(tmp_path / 'tmp').iterdir(), *(tmp_path / 'page').iterdir()] == []


def test_a_log_that_is_too_short_for_a_diagnosis_is_weighed(tmp_path: Path) -> None:
    log = tmp_path / 'short.csv'
    _log_at_rest(log, 1, 200)
    row = diagnose_and_weigh(LogTask('a', str(log), 'reference', str(tmp_path / 'page')))
    assert row.error.startswith('diagnose: expected at least') and not row.verdict
    assert row.payload_kg is not None and row.payload_status == 'not_excited'


def test_logs_belong_to_the_nearest_robot_file(tmp_path: Path) -> None:
    bag = tmp_path / 'night' / 'a' / 'bag'
    bag.mkdir(parents=True)
    (bag / 'metadata.yaml').touch()
    (bag / 'bag.db3').touch()
    (tmp_path / 'night' / 'a' / 'robot.yaml').touch()
    (tmp_path / 'night' / 'b.csv').touch()
    out = tmp_path / 'night' / 'out'
    out.mkdir()
    (out / 'fleet.csv').touch()
    night = tmp_path / 'night'
    found = logs_below([str(night)], out)
    assert found == [(night, bag), (night, night / 'b.csv')]
    assert robot_of(night, bag, 'reference') == str(night / 'a' / 'robot.yaml')
    assert robot_of(night, night / 'b.csv', 'reference') == 'reference'
    assert [arm_of(*item) for item in found] == ['night/a', 'night']
    with pytest.raises(InputError, match='out: expected logs, got the folder that a fleet writes'):
        logs_below([str(out)], out)
    with pytest.raises(InputError, match='name another by --out'):
        logs_below([str(night)], night)


def test_a_log_that_is_found_twice_counts_once(tmp_path: Path) -> None:
    for name in ('a/1.csv', 'b/2.CSV'):
        _log_at_rest(tmp_path / name, 1)
    (tmp_path / 'a' / 'around').symlink_to(tmp_path)
    found = logs_below([str(tmp_path), str(tmp_path / 'b')], tmp_path / 'out')
    assert found == [(tmp_path, tmp_path / 'a' / '1.csv'), (tmp_path, tmp_path / 'b' / '2.CSV')]


def test_a_bag_is_no_folder_of_logs(tmp_path: Path) -> None:
    (tmp_path / 'metadata.yaml').touch()
    with pytest.raises(InputError, match='expected a folder of logs, got one bag'):
        logs_below([str(tmp_path)], tmp_path / 'out')


def test_a_log_keeps_its_page_when_others_join(tmp_path: Path) -> None:
    out = tmp_path / 'out'
    options = fleet_options().parse_args([str(tmp_path / 'night'), '--out', str(out)])
    for name in ('a.csv', 'c.csv'):
        _log_at_rest(tmp_path / 'night' / name, 1)
    before = {task.log: task.report for task in tasks_of(options, out)}
    _log_at_rest(tmp_path / 'night' / 'b.csv', 2)
    after = {task.log: task.report for task in tasks_of(options, out)}
    assert before.items() <= after.items() and len(set(after.values())) == 3


def test_what_was_given_up_is_done_again_and_what_was_not_needs_no_more_time(
        tmp_path: Path) -> None:
    short, long = (LogTask('arm', str(tmp_path / 'log.csv'), 'reference', str(tmp_path / 'page'),
                           timeout=timeout) for timeout in (1.0, 600.0))
    journal = Journal(tmp_path / 'out')
    journal.add(short, Row('arm', short.log, error='given up', again=True))
    assert 'does not exist' in run([long], journal, None, 1)[0].error
    assert 'does not exist' in run([short], journal, None, 1)[0].error
    assert len(journal.file.read_text().splitlines()) == 2


def test_only_what_log_and_program_decide_is_remembered(
        tmp_path: Path, repository: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / '1.mcap').write_bytes(b'no bag')
    (tmp_path / 'bare').mkdir()
    (tmp_path / 'bare' / 'rosbags.py').write_text('raise ImportError')
    task = LogTask('a', str(tmp_path / '1.mcap'), 'reference', str(tmp_path / 'page'))
    journal = Journal(tmp_path / 'out')
    for path, error, count in ((tmp_path / 'bare', 'needs the package rosbags', 0),
                               (repository, 'expected a rosbag2', 1)):
        monkeypatch.setenv('PYTHONPATH', f'{path}{os.pathsep}{repository}')
        row = diagnose_and_weigh(task)
        journal.add(task, row)
        assert error in row.error and len(journal.rows()) == count
    older = journal.file.read_text().replace(f'["{version("flex_payload")}"', '["0.0.9"')
    journal.file.write_text(older)
    assert not journal.rows(), 'another version may answer otherwise'


def test_a_tool_without_memory_is_run_again(tmp_path: Path) -> None:
    _log_at_rest(tmp_path / '1.csv', 1)
    said = subprocess.run(
        ['bash', '-c', 'ulimit -v 500000; exec "$@"', '', sys.executable, '-c', WORKER,
         str(tmp_path / '1.csv'), str(tmp_path / 'page')], text=True, capture_output=True)
    assert said.stdout == 'True estimate: ulimit -v: expected at least 600000, got 500000\n', said


def test_names_of_any_bytes_cost_no_table(tmp_path: Path) -> None:
    name = os.fsdecode(b'night/\xff')
    _log_at_rest(tmp_path / name / '1.csv', 1)
    task = LogTask(name, str(tmp_path / name / '1.csv'), 'reference', str(tmp_path / 'page'))
    journal = Journal(tmp_path / 'out')
    journal.add(task, Row(name, task.log, error='given up'))
    rows = run([task], journal, None, 1)
    write_csv(journal, rows)
    assert rows[0].arm == 'night/ ' and _table(tmp_path)[0]['error'] == 'given up'
    assert fleet(['night', '--out', os.fsdecode(b'o\xff')]) == 2


def test_workers_of_this_machine_are_none_of_a_scheduler_s(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert fleet([str(tmp_path), '--out', str(tmp_path / 'out'), '--workers', '2',
                  '--scheduler', 'tcp://127.0.0.1:1']) == 2
    assert '--workers: expected none with --scheduler' in capsys.readouterr().err


@pytest.mark.parametrize(('again', 'code'), [(True, 75), (False, 2)])
def test_logs_that_may_do_later_are_no_bad_input(
        again: bool, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _log_at_rest(tmp_path / 'night' / '1.csv', 1, 20)
    failed = Row('night', '1.csv', error='the worker died', again=again)
    monkeypatch.setattr('flex_payload_estimator.tools.fleet.run', lambda *_: [failed])
    assert fleet([str(tmp_path / 'night'), '--out', str(tmp_path / 'out')]) == code


def test_a_strangers_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / 'thesis.txt').write_text('mine')
    with pytest.raises(InputError, match='expected an empty folder'):
        Journal(tmp_path)
    assert [item.name for item in tmp_path.iterdir()] == ['thesis.txt']


HOLDER = """
from pathlib import Path
import sys
import time
from flex_payload_estimator.fleet.journal import Journal
journal = Journal(Path(sys.argv[1]))
print('held', flush=True)
time.sleep(600)
"""


def test_two_fleets_do_not_share_a_folder(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _log_at_rest(tmp_path / 'night' / '1.csv', 1, 20)
    out = tmp_path / 'out'
    arguments = [str(tmp_path / 'night'), '--out', str(out), '--workers', '1']
    other = subprocess.Popen([sys.executable, '-c', HOLDER, str(out)], text=True,
                             stdout=subprocess.PIPE)
    assert other.stdout is not None and other.stdout.readline() == 'held\n'
    try:
        assert fleet(arguments) == 2
        assert capsys.readouterr().err == (
            f'error: {out}: expected a folder of its own, got one that another flex_fleet is '
            'writing to\n')
        assert [item.name for item in out.iterdir()] == ['fleet.jsonl']
    finally:
        other.kill()
        other.communicate()
    # What is killed holds nothing, and neither does a journal that nobody uses any more.
    for _ in range(2):
        Journal(out).add(LogTask('a', '1', 'reference', ''), Row('a', '1'))


def test_a_line_cut_short_by_a_kill_loses_only_itself(tmp_path: Path) -> None:
    journal = Journal(tmp_path / 'out')
    tasks = [LogTask('a', f'{k}.csv', 'reference', 'page') for k in range(3)]
    journal.add(tasks[0], Row('a', '0.csv', 'cause', causes=('backlash:joint_1',)))
    with journal.file.open('a') as file:
        file.write(json.dumps(['0.1.0', tasks[1].key, {'arm': 'a'}])[:-9])
    journal.add(tasks[2], Row('a', '2.csv'))
    rows = journal.rows()
    assert set(rows) == {tasks[0].key, tasks[2].key}
    assert rows[tasks[0].key].causes == ('backlash:joint_1',)


def test_a_log_is_known_as_it_was_met(tmp_path: Path) -> None:
    # Too short for a diagnosis, whose answer would not be believed either.
    _log_at_rest(tmp_path / 'night' / 'a.csv', 1, 200)
    task, = tasks_of(fleet_options().parse_args(
        [str(tmp_path / 'night'), '--out', str(tmp_path / 'out')]), tmp_path / 'out')
    key = task.key
    with (tmp_path / 'night' / 'a.csv').open('a') as file:
        file.write('more')
    assert task.key == key != task.present_key()
    row = diagnose_and_weigh(task)
    assert row.error == 'the log or its robot file changed while it was read' and not row.report


def test_each_setting_has_its_page_and_each_arm_its_name(tmp_path: Path) -> None:
    for side in ('left', 'right'):
        _log_at_rest(tmp_path / side / 'logs' / '1.csv', 1)
    folders = [str(tmp_path / side / 'logs') for side in ('left', 'right')]
    tasks = [tasks_of(fleet_options().parse_args([*folders, '--out', 'out', *more]),
                      tmp_path / 'out') for more in ([], ['--payload', '0.3'])]
    assert len({task.report for some in tasks for task in some}) == 4
    assert [task.arm for task in tasks[0]] == folders


def test_what_was_killed_is_done_again_and_a_damaged_line_is_passed_over(tmp_path: Path) -> None:
    journal = Journal(tmp_path / 'out')
    for name, again in (('a', True), ('b', False)):
        journal.add(LogTask(name, name, 'reference', ''), Row(name, name, again=again))
    with journal.file.open('ab') as file:
        file.write(b'\xff\xfe\n')
    assert [row.log for row in journal.rows().values()] == ['b']


def test_the_table_of_another_fleet_is_no_log(tmp_path: Path) -> None:
    _log_at_rest(tmp_path / '1.csv', 1)
    Journal(tmp_path / 'earlier')
    (tmp_path / 'earlier' / 'fleet.csv').touch()
    assert [log for _, log in logs_below([str(tmp_path)], tmp_path / 'out')] == [
        tmp_path / '1.csv']
