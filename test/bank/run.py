"""Run one case: make the record, give it to flex_diagnose, keep its answer beside the truth."""

from __future__ import annotations

from dataclasses import replace
import json
from pathlib import Path
import subprocess
import sys
from tempfile import TemporaryDirectory
import time
from typing import Any

from bank.cases import BankCase
from bank.records import write_record
from bank.sizes import Limits, relative_size, sized_truth
from truth.records import TruthCase

TRACEBACK = 1  # what Python exits with after one
KEPT = ('verdict', 'sentence', 'causes', 'sets', 'cannot_tell', 'probabilities', 'not_excited',
        'remainder', 'gain')


def run_case(case: BankCase, limits: Limits) -> dict[str, Any]:
    """
    Return a case's line of results: its answer and what was hidden.

    Parameters
    ----------
    case : BankCase
        The case to run.
    limits : Limits
        Of a clean record of the same robot.

    """
    truth, terms = sized_truth(case, limits)
    line = {'key': case.key, 'kind': case.kind, 'names': list(case.hidden),
            'robot': case.robot, 'seed': case.seed, 'size': case.size, 'spread': truth.spread,
            'simulator': case.realisation.simulator, 'form': case.realisation.form,
            'calibration': case.realisation.calibration,
            'distractors': [name for name in truth.names if name not in case.hidden],
            'truth': [{'name': term.name, 'site': term.site, 'values': term.values,
                       'times_limit': relative_size(term, limits.value)} for term in terms]}
    with TemporaryDirectory() as folder:
        path = Path(folder) / 'record.csv'
        try:
            write_record(case, truth, path)
        except FloatingPointError as error:
            # With the hidden effect the true arm's own controller is not stable.
            return {**line, 'unmade': str(error)}
        started = time.perf_counter()
        code, answer, complaint = diagnose_file(path, case, truth)
    return {**line, 'code': code, 'complaint': complaint,
            'seconds': round(time.perf_counter() - started, 2),
            **{key: answer[key] for key in KEPT if key in answer}}


def limits_answer(robot: str) -> dict[str, Any]:
    """Return the tool's answer, with detection limits, to a clean record of nominal parts."""
    case = BankCase('limits', (), robot, 1, size=0.0)
    truth = replace(case.truth(), tolerances=False)
    with TemporaryDirectory() as folder:
        path = Path(folder) / 'record.csv'
        write_record(case, truth, path)
        code, answer, complaint = diagnose_file(path, case, truth)
    if code != 0:
        raise RuntimeError(complaint)
    return answer


def diagnose_file(path: Path, case: BankCase, truth: TruthCase) -> tuple[int, dict[str, Any], str]:
    """
    Return the tool's exit code, its JSON and its error output.

    The tool runs in a process of its own, so that the bank goes on after a traceback.
    """
    answer = path.with_suffix('.json')
    command = [sys.executable, '-m', 'flex_payload_estimator.tools.diagnose', str(path), '--robot',
               case.robot, '--payload', f'{truth.payload_told:.9g}', '--json', str(answer),
               '--jobs', '1', *case.options]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    found = json.loads(answer.read_text(encoding='utf-8')) if answer.is_file() else {}
    return done.returncode, found, done.stderr.strip()
