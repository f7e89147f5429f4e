"""What is said of a log when it is read, in the answer of flex_diagnose."""

from __future__ import annotations

from dataclasses import replace
import json
from pathlib import Path

from flex_payload_estimator.tools.diagnose import main
from flex_plant_sim.diagnosis.verdict.log_hints import with_hints
from flex_plant_sim.diagnosis.verdict.results import Diagnosis, Hint
from flex_plant_sim.effects import catalogue
from flex_plant_sim.logs.log import Log
from flex_plant_sim.tools.log_input import read_logs
import numpy as np
import pytest
from simulated_records import REFERENCE, simulated, write

EXCHANGED = 'joint_1 and joint_2 look exchanged, or the commands'


def exchanged(path: Path) -> Path:
    """Write a log whose joints' columns are exchanged."""
    record = simulated(duration=14.0)
    return write(replace(record, output=record.output[:, [1, 0, 2, 3, 4, 5]]), path)


def noted(name: str, *notes: str, misread: int = 0) -> Log:
    """Return a log with notes, of which the last ones are on channels that are misread."""
    none = np.zeros((0, 2))
    return Log(name, np.zeros(0), none, none, none, (), notes,
               misread=notes[len(notes) - misread:])


def test_what_stderr_says_stays_with_the_log(tmp_path: Path,
                                             capsys: pytest.CaptureFixture[str]) -> None:
    path = str(exchanged(tmp_path / 'log.csv'))
    log, = read_logs([path], REFERENCE, 'assumed_modes', 3)
    assert EXCHANGED in log.misread
    assert capsys.readouterr().err.splitlines() == [f'{path}: {note}' for note in log.notes]
    whole, = read_logs([str(write(simulated(duration=12.0), tmp_path / 'whole.csv'))], REFERENCE,
                       'assumed_modes', 3)
    assert not whole.misread


def test_only_channels_that_are_misread_put_the_answer_in_doubt() -> None:
    said = Diagnosis('nothing_wrong', 'All is well.')
    plain = with_hints(said, [noted('a.csv', 'sampled slowly'), noted('b.csv')])
    assert plain == replace(said, hints=(Hint('a.csv', 'sampled slowly'),))
    doubted = with_hints(said, [noted('a.csv', 'note', 'x?', misread=1),
                                noted('b.csv', 'y?', 'z?', misread=2)])
    assert doubted.sentence == ('The log may not be what it was read as (x?; 2 more like it), and '
                                'what follows depends on it. All is well.')
    assert [(hint.file, hint.text) for hint in doubted.hints] == [
        ('a.csv', 'note'), ('a.csv', 'x?'), ('b.csv', 'y?'), ('b.csv', 'z?')]


def test_exchanged_joints_reach_every_answer(tmp_path: Path,
                                             capsys: pytest.CaptureFixture[str]) -> None:
    path, answer = exchanged(tmp_path / 'log.csv'), tmp_path / 'answer.json'
    assert main([str(path), '--json', str(answer), '--report', str(tmp_path), '--jobs=1', *(
        f'--exclude={name}' for name in catalogue() if name != 'input_delay')]) == 0
    out, err = capsys.readouterr()
    first = out.splitlines()[1]
    assert first.startswith(f'The log may not be what it was read as ({EXCHANGED}')
    assert 'seem to be logged' not in out
    found = json.loads(answer.read_text(encoding='utf-8'))
    assert found['sentence'] == first
    assert {'file': str(path), 'text': EXCHANGED} in found['hints']
    assert [f'{hint["file"]}: {hint["text"]}' for hint in found['hints']] == err.splitlines()
    assert EXCHANGED in (tmp_path / 'report.html').read_text(encoding='utf-8')
