"""One log of the fleet: flex_diagnose and flex_estimate run on it as processes and give a Row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
import json
import os
from pathlib import Path
import subprocess
import sys
import time
from typing import Any

from msg_config.errors import BAD_INPUT, LONGEST

# Runs a tool so that it ends with the worker that waits for it.
BOUND = 'flex_payload_estimator.tools.bound'
DIAGNOSE = 'flex_payload_estimator.tools.diagnose'
ESTIMATE = 'flex_payload_estimator.tools.estimate'


@dataclass(frozen=True)
class LogTask:
    """
    A log and the settings with which it is diagnosed and weighed.

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
        Payload that the operator believes the arm carries, kg; the robot file's if None.
    timeout : float
        Time after which a tool is given up, s.

    """

    arm: str
    log: str
    robot: str
    report: str
    payload: float | None = None
    timeout: float = 600.0

    @cached_property
    def key(self) -> str:
        """Return what the row depends on: settings, log and robot file as they were met."""
        return self.present_key()

    def present_key(self) -> str:
        """Return the key with the present state of log and robot file."""
        return json.dumps([self.settings, _stamp(Path(self.log)), _stamp(Path(self.robot))])

    @property
    def settings(self) -> str:
        """Return the log and what it is diagnosed with."""
        return json.dumps([self.log, self.robot, self.payload])


@dataclass(frozen=True)
class Row:
    """
    The result for one log; texts are empty and numbers None where something failed.

    Attributes
    ----------
    arm, log : str
    verdict, sentence : str
        As flex_diagnose states them.
    causes : tuple of str
        identifier:site, the likeliest first.
    probability : float or None
        Probability of the likeliest cause.
    payload_kg, payload_std_kg : float or None
        Estimate and standard deviation at the end of the log.
    payload_status : str
        The estimator's status there.
    report : str
        Path of the log's page.
    seconds : float
        Time that the log took, s.
    error : str
        One line, where anything failed.
    again : bool
        Whether log, robot and settings may not be to blame, as after a signal or `timeout`, or
        without memory: the log is done again at the next start.

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
    again: bool = False


def diagnose_and_weigh(task: LogTask) -> Row:
    """
    Return the row of a log; a failure of log or tool is told in the row, not raised.

    What is to be done again ends the work on the log.
    """
    started = time.monotonic()
    told = [] if task.payload is None else ['--payload', str(task.payload)]
    page = Path(task.report)
    page.mkdir(parents=True, exist_ok=True)
    # A log that cannot be diagnosed may still be weighed.
    weight, error, again = _run_tool(task, ESTIMATE, [], started)
    diagnosis: dict[str, Any] = {}
    wrong = ''
    if not again:
        diagnosis, wrong, again = _run_tool(
            task, DIAGNOSE, [*told, '--jobs', '1', '--report', str(page)], started)
    if task.present_key() != task.key:
        # Whatever the tools say of one that is still being copied.
        diagnosis, weight, wrong = {}, {}, 'the log or its robot file changed while it was read'
    causes = sorted(diagnosis.get('causes', ()), key=lambda cause: -cause['probability'])
    return Row(
        task.arm, task.log, diagnosis.get('verdict', ''), diagnosis.get('sentence', ''),
        tuple(f'{cause["name"]}:{cause["site"]}' for cause in causes),
        causes[0]['probability'] if causes else None, weight.get('mass_kg'),
        weight.get('std_kg'), weight.get('status', ''),
        str(page / 'report.html') if diagnosis else '',
        time.monotonic() - started, wrong or error, again)


def _run_tool(task: LogTask, module: str, options: Sequence[str], started: float
              ) -> tuple[dict[str, Any], str, bool]:
    """
    Return a tool's JSON on the log, or an empty one, its error, and whether to do it again.

    The error is one line. Both tools share the task's time, from `started` on, s of the monotonic
    clock.
    """
    tool = module.rpartition('.')[2]
    # In the fleet's own folder, so that a worker that is killed leaves nothing elsewhere.
    file = Path(task.report) / f'{tool}.json'
    command = [sys.executable, '-m', BOUND, str(os.getpid()), module, task.log, '--robot',
               task.robot, '--json', str(file), *options]
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True,
                              text=True, errors='replace',
                              timeout=max(task.timeout - (time.monotonic() - started), 0.0))
    except subprocess.TimeoutExpired:
        return {}, f'{tool}: given up after {task.timeout:g} s', True
    if done.returncode == 0 and file.is_file():
        answer: dict[str, Any] = json.loads(file.read_text(encoding='utf-8'))
        file.unlink()
        return answer, '', False
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    last = lines[-1] if lines else f'exit code {done.returncode}'
    if done.returncode < 0:
        last = f'killed by signal {-done.returncode}'
    last = last.removeprefix('error: ').removeprefix(f'{task.log}: ')
    return {}, f'{tool}: {last}'[:LONGEST], done.returncode != BAD_INPUT


def _stamp(path: Path) -> list[float]:
    """Return sizes and times of modification of a file, or of the files of a bag folder."""
    if not path.exists():
        return []
    files = sorted(path.rglob('*')) if path.is_dir() else [path]
    return [number for file in files if file.is_file()
            for number in (file.stat().st_size, file.stat().st_mtime)]
