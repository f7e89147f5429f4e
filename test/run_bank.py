"""The bank of hidden effects; `make bank` runs it whole. An interrupted run goes on later."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
import json
from multiprocessing import get_context
from pathlib import Path
import sys
from typing import Any

from bank import summary
from bank.cases import all_cases, BankCase, first, limit_case
from bank.run import run_case
from bank.sizes import Limits, stated_limits
from tqdm import tqdm

REPOSITORY = Path(__file__).resolve().parents[1]
RESULTS = REPOSITORY / 'build' / 'bank.jsonl'


def options() -> argparse.Namespace:
    """Return the parsed options."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument('--draws', type=int, default=5, help='per identifier')
    parser.add_argument('--clean', type=int, default=60, help='clean arms')
    parser.add_argument('--jobs', type=int, default=2, help='processes')
    parser.add_argument('--only', default='', help='cases whose name contains this')
    parser.add_argument('--count', type=int, default=None, help='stop after so many cases')
    parser.add_argument('--results', type=Path, default=RESULTS, help='one JSON line a case')
    parser.add_argument('--fresh', action='store_true', help='forget earlier results')
    parser.add_argument('--so-far', action='store_true',
                        help='run nothing; report on the results that are there')
    parser.add_argument('--docs', type=Path, default=REPOSITORY / 'docs',
                        help='folder for bank.md and bank.png')
    return parser.parse_args()


def read_results(path: Path) -> dict[str, dict[str, Any]]:
    """Return earlier results by key; a line cut short by an interruption is left out."""
    found = {}
    for text in path.read_text(encoding='utf-8').splitlines() if path.is_file() else []:
        try:
            line = json.loads(text)
        except json.JSONDecodeError:
            continue
        found[line['key']] = line
    return found


def run_all(cases: list[BankCase], known: dict[str, dict[str, Any]], path: Path,
            jobs: int) -> dict[str, dict[str, Any]]:
    """Return all results, each kept as soon as it is there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    robots = dict.fromkeys(case.robot for case in cases)
    needed = [case for case in map(limit_case, robots) if case.key not in known]
    with open(path, 'a', encoding='utf-8') as file, get_context('spawn').Pool(
            jobs, maxtasksperchild=20) as pool:
        known |= _keep(pool.imap_unordered(_run, [(case, {}) for case in needed]), file, needed)
        limits = {robot: stated_limits(known[limit_case(robot).key]) for robot in robots}
        open_cases = [case for case in cases if case.key not in known]
        known |= _keep(pool.imap_unordered(
            _run, [(case, limits[case.robot]) for case in open_cases]), file, open_cases)
    return known


def _keep(results: Iterable[dict[str, Any]], file: Any,
          cases: list[BankCase]) -> dict[str, dict[str, Any]]:
    found = {}
    for line in _with_bar(results, len(cases)):
        file.write(json.dumps(line) + '\n')
        file.flush()
        found[line['key']] = line
    return found


def _with_bar(results: Iterable[dict[str, Any]], total: int) -> Iterator[dict[str, Any]]:
    yield from tqdm(results, total=total, disable=None, unit='case')


def _run(work: tuple[BankCase, Limits]) -> dict[str, Any]:
    return run_case(*work)


def main() -> int:
    """Run what is still to run, print the figures and write docs/bank.md."""
    chosen = options()
    if chosen.fresh:
        chosen.results.unlink(missing_ok=True)
    known = read_results(chosen.results)
    cases = first(all_cases(chosen.draws, chosen.clean), chosen.only, chosen.count)
    if chosen.so_far:
        cases = [case for case in cases if case.key in known]
    else:
        known = run_all(cases, known, chosen.results, chosen.jobs)
    lines = [known[case.key] for case in cases]
    print(summary.terminal_matrix(lines))
    for what, demand, found, met in summary.figures(lines):
        mark = '' if met is None else (' met' if met else ' MISSED')
        print(f'{what:<75} {demand:>12}  {found}{mark}')
    if not chosen.only and chosen.count is None:
        summary.write_picture(chosen.docs / 'bank.png', lines)
        (chosen.docs / 'bank.md').write_text(summary.text(lines, 'bank.png'), encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
