"""One log of the fleet: diagnosed and weighed by the tools, in processes of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import json
from pathlib import Path
import subprocess
import sys
from tempfile import TemporaryDirectory
import time
from typing import Any

from msg_config.errors import LONGEST

DIAGNOSE = 'flex_payload_estimator.tools.diagnose'
ESTIMATE = 'flex_payload_estimator.tools.estimate'


@dataclass(frozen=True)
class LogTask:
    """
    What is to be done with one log.

    Attributes
    ----------
    arm : str
        Name of the arm, for the table.
    log : str
        File or bag folder.
    robot : str
        Built-in robot or robot file.
    report : str
        Folder for the log's page.
    payload : float or None
        What the operator believes the arm carries, kg; the robot file's if None.
    timeout : float
        After so many seconds a log is given up.

    """

    arm: str
    log: str
    robot: str
    report: str
    payload: float | None = None
    timeout: float = 600.0

    @property
    def key(self) -> str:
        """Return what the answer depends on: the log and robot as they are now, the settings."""
        stamps = [_stamp(Path(self.log)), _stamp(Path(self.robot))]
        return json.dumps([self.log, self.robot, self.payload, *stamps])


@dataclass(frozen=True)
class Row:
    """
    What is known of one log; an empty text or None where something failed.

    Attributes
    ----------
    arm, log : str
    verdict, sentence : str
        As flex_diagnose states them.
    causes : tuple of str
        identifier:site, the likeliest first.
    probability : float or None
        Of the likeliest cause.
    payload_kg, payload_std_kg : float or None
        At the end of the log.
    payload_status : str
    report : str
        The log's page.
    seconds : float
        What the log took.
    error : str
        One line, where anything failed.

    """

    arm: str
    log: str
    verdict: str = ''
    sentence: str = ''
    causes: tuple[str, ...] = ()
    probability: float | None = None
    payload_kg: float | None = None
    payload_std_kg: float | None = None
    payload_status: str = ''
    report: str = ''
    seconds: float = 0.0
    error: str = ''


def answer(task: LogTask) -> Row:
    """Return the row of a log; never raises for what the log or a tool does."""
    started = time.monotonic()
    told = [] if task.payload is None else ['--payload', str(task.payload)]
    page = Path(task.report)
    page.mkdir(parents=True, exist_ok=True)
    diagnosis, wrong = _asked(task, DIAGNOSE, [*told, '--jobs', '1', '--report', str(page)])
    weight, error = ({}, '') if wrong else _asked(task, ESTIMATE, [])
    causes = sorted(diagnosis.get('causes', ()), key=lambda cause: -cause['probability'])
    return Row(
        task.arm, task.log, diagnosis.get('verdict', ''), diagnosis.get('sentence', ''),
        tuple(f'{cause["name"]}:{cause["site"]}' for cause in causes),
        causes[0]['probability'] if causes else None, weight.get('mass_kg'),
        weight.get('std_kg'), weight.get('status', ''),
        str(page / 'report.html') if (page / 'report.html').is_file() else '',
        time.monotonic() - started, wrong or error)


def _asked(task: LogTask, module: str, options: Sequence[str]) -> tuple[dict[str, Any], str]:
    """Return what a tool says of the log as JSON, or nothing and its one-line error."""
    tool = module.rpartition('.')[2]
    with TemporaryDirectory(prefix='flex_fleet_') as folder:
        file = Path(folder) / 'answer.json'
        command = [sys.executable, '-m', module, task.log, '--robot', task.robot, '--json',
                   str(file), *options]
        try:
            done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True,
                                  text=True, errors='replace', timeout=task.timeout)
        except subprocess.TimeoutExpired:
            return {}, f'{tool}: given up after {task.timeout:g} s'
        if done.returncode == 0 and file.is_file():
            return json.loads(file.read_text(encoding='utf-8')), ''
        said = [line for line in done.stderr.splitlines() if line.strip()]
        last = said[-1] if said else f'exit code {done.returncode}'
        last = last.removeprefix('error: ').removeprefix(f'{task.log}: ')
        return {}, f'{tool}: {last}'[:LONGEST]


def _stamp(path: Path) -> list[float]:
    """Return what changes when a file or a bag folder is written anew."""
    if not path.exists():
        return []
    files = sorted(path.rglob('*')) if path.is_dir() else [path]
    return [number for file in files if file.is_file()
            for number in (file.stat().st_size, file.stat().st_mtime)]
