"""Run one case: make the record, hand it to flex_diagnose, keep its answer beside the truth."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
import json
import math
from pathlib import Path
from tempfile import TemporaryDirectory
import time
from typing import Any

from bank.cases import BankCase
from bank.records import write_record
from bank.terms import hidden_terms, Term
from flex_plant_sim.tools.diagnose import main
from truth.records import TruthCase

TIMES_LIMIT = 3.0
LARGEST_SEVERITY = 4.0
KEPT = ('verdict', 'sentence', 'causes', 'cannot_tell', 'not_excited')
SIZED = ('one', 'missing', 'pair')

Limits = Mapping[str, float]


def run_case(case: BankCase, limits: Limits) -> dict[str, Any]:
    """
    Return a case's line of results: its answer and what was hidden.

    Parameters
    ----------
    case : BankCase
        What to hide.
    limits : Mapping
        'identifier:site' to the detection limit of a clean record of the same robot.

    """
    truth, terms = sized_truth(case, limits)
    with TemporaryDirectory() as folder:
        path = Path(folder) / 'record.csv'
        write_record(case, truth, path)
        started = time.perf_counter()
        code, answer, complaint = diagnose_file(path, case, truth)
    found = {'key': case.key, 'kind': case.kind, 'names': list(case.names),
             'robot': case.robot, 'seed': case.seed, 'code': code, 'complaint': complaint,
             'seconds': round(time.perf_counter() - started, 2),
             'truth': [{'name': term.name, 'site': term.site, 'values': term.values,
                        'times_limit': relative_size(term, limits)} for term in terms]}
    if case.kind == 'limits':
        found['limits'] = answer.get('detection_limits', {})
    return {**found, **{key: answer[key] for key in KEPT if key in answer}}


def diagnose_file(path: Path, case: BankCase,
                  truth: TruthCase) -> tuple[int, dict[str, Any], str]:
    """Return the tool's exit code, its JSON and what it complained of."""
    answer = path.with_suffix('.json')
    errors = StringIO()
    with redirect_stdout(StringIO()), redirect_stderr(errors):
        code = main([str(path), '--robot', case.robot, '--payload', f'{truth.payload_told:.9g}',
                     '--json', str(answer), '--jobs', '1', *case.options])
    found = json.loads(answer.read_text(encoding='utf-8')) if answer.is_file() else {}
    return code, found, errors.getvalue().strip()


def sized_truth(case: BankCase, limits: Limits) -> tuple[TruthCase, tuple[Term, ...]]:
    """Return the case's truth, its effects at least three detection limits in size."""
    severity = 1.0
    truth, terms = _at(case, severity)
    if case.kind in SIZED:
        known = [ratio for term in terms
                 if (ratio := relative_size(term, limits)) is not None and ratio > 0.0]
        if known and min(known) < TIMES_LIMIT:
            severity = min(1.02 * TIMES_LIMIT / min(known), LARGEST_SEVERITY)
            truth, terms = _at(case, severity)
    return truth, terms


def _at(case: BankCase, severity: float) -> tuple[TruthCase, tuple[Term, ...]]:
    truth = case.truth(severity)
    named = () if case.kind == 'control' else hidden_terms(truth)[:len(case.names)]
    return truth, named


def relative_size(term: Term, limits: Limits) -> float | None:
    """Return an effect's size over its detection limit; None where either is unknown."""
    limit = limits.get(f'{term.name}:{term.site}')
    if limit is None or not limit > 0.0 or math.isnan(term.size):
        return None
    return term.size / limit
