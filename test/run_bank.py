"""The bank of hidden effects; `make bank` runs it whole. An interrupted run goes on later."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
import json
import os
from pathlib import Path
import subprocess
import sys
from typing import Any

from bank import summary
from bank.cases import all_cases, BankCase, first, FIRST_SEED, SEEDS_PER_ROUND
from bank.picture import write_picture
from bank.run import limits_answer, run_case
from bank.sizes import can_show, Limits, LIMITS_FILE, read_limits, write_limits
from flex_payload_estimator.fleet.schedule import cluster, RETRIES
from tqdm import tqdm
from truth.records import HAVE_MUJOCO, MUJOCO, NO_MUJOCO

REPOSITORY = Path(__file__).resolve().parents[1]
RESULTS = REPOSITORY / 'build' / 'bank.jsonl'


def options() -> argparse.Namespace:
    """Return the parsed options."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument('--use', choices=sorted(FIRST_SEED), default='scoring',
                        help='seeds and forms to take; what scores must never be tuned on')
    parser.add_argument('--rounds', type=int, default=9, help='cases of every identifier')
    parser.add_argument('--first-round', type=int, default=0,
                        help='rounds before it are left out: 15 begins at seed 6500')
    parser.add_argument('--jobs', type=int, default=2, help='workers on this machine')
    parser.add_argument('--scheduler', metavar='ADDRESS',
                        help='a Dask scheduler, whose workers have this folder in PYTHONPATH')
    parser.add_argument('--only', default='', help='cases whose name contains this')
    parser.add_argument('--count', type=int, default=None, help='stop after so many cases')
    parser.add_argument('--results', type=Path, default=RESULTS, help='one JSON line a case')
    parser.add_argument('--fresh', action='store_true', help='forget earlier results')
    parser.add_argument('--so-far', action='store_true',
                        help='run nothing; report on the results that are there')
    parser.add_argument('--against', type=Path, help='results of another run to compare with')
    parser.add_argument('--limits', action='store_true',
                        help=f'find the detection limits anew and keep them in {LIMITS_FILE.name}')
    parser.add_argument('--docs', type=Path, default=RESULTS.parent,
                        help='folder for bank.md and bank.png')
    return parser.parse_args()


def present_commit() -> str:
    """Return the commit that is judged, with a + where the code differs from it."""
    def git(*arguments: str) -> str:
        return subprocess.run(['git', *arguments], cwd=REPOSITORY, check=True, text=True,
                              capture_output=True).stdout.strip()
    changed = git('status', '--porcelain', '--', 'flex_plant_sim', 'msg_config', 'test/bank',
                  'test/truth')
    return git('rev-parse', '--short', 'HEAD') + '+' * bool(changed)


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


def run_all(cases: list[BankCase], known: dict[str, dict[str, Any]],
            chosen: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """Return all results, each kept as soon as it is there; a case survives its worker."""
    chosen.results.parent.mkdir(parents=True, exist_ok=True)
    limits, commit = read_limits(), present_commit()
    work = [(case, limits[case.robot], commit) for case in cases if case.key not in known]
    # Workers of this machine look for the bank where this program does.
    os.environ['PYTHONPATH'] = os.pathsep.join([str(Path(__file__).parent), str(REPOSITORY)])
    with open(chosen.results, 'a', encoding='utf-8') as file, cluster(
            chosen.scheduler, chosen.jobs) as client:
        from distributed import as_completed
        futures = as_completed(client.map(_run, work, pure=False, retries=RETRIES))
        return known | _keep((future.result() for future in futures), file, len(work))


def _keep(results: Iterable[dict[str, Any]], file: Any,
          total: int) -> dict[str, dict[str, Any]]:
    found = {}
    for line in _with_bar(results, total):
        file.write(json.dumps(line) + '\n')
        file.flush()
        found[line['key']] = line
    return found


def _with_bar(results: Iterable[dict[str, Any]], total: int) -> Iterator[dict[str, Any]]:
    yield from tqdm(results, total=total, disable=None, unit='case')


def _run(work: tuple[BankCase, Limits, str]) -> dict[str, Any]:
    case, limits, commit = work
    return {**run_case(case, limits), 'commit': commit}


def chosen_cases(chosen: argparse.Namespace) -> list[BankCase]:
    """Return the cases that are asked for, may show what they hide, and can be run here."""
    limits = read_limits()
    fresh = FIRST_SEED[chosen.use] + SEEDS_PER_ROUND * chosen.first_round
    drawn = all_cases(chosen.use, chosen.first_round + chosen.rounds)
    cases = first((case for case in drawn if case.seed >= fresh
                   and can_show(case, limits[case.robot])), chosen.only, chosen.count)
    if HAVE_MUJOCO:
        return cases
    left = [case for case in cases if case.realisation.simulator != MUJOCO]
    print(f'{NO_MUJOCO}: {len(cases) - len(left)} of {len(cases)} cases are left out')
    return left


def report(lines: list[dict[str, Any]], chosen: argparse.Namespace) -> None:
    """Print the figures; a run of all kinds of cases also makes the page."""
    print(summary.terminal_matrix(lines))
    for what, demand, found, met in summary.figures(lines):
        mark = '' if met is None else (' met' if met else ' MISSED')
        print(f'{what:<75} {demand:>12}  {found}{mark}')
    if chosen.against:
        print(summary.paired(lines, list(read_results(chosen.against).values())))
    if lines and not chosen.only:
        commit = ', '.join(sorted({line['commit'] for line in lines}))
        chosen.docs.mkdir(parents=True, exist_ok=True)
        write_picture(chosen.docs / 'bank.png', lines)
        (chosen.docs / 'bank.md').write_text(summary.text(lines, commit, 'bank.png'),
                                             encoding='utf-8')


def main() -> int:
    """Run what is still to run, print the figures and write bank.md and bank.png."""
    chosen = options()
    if chosen.limits:
        write_limits({robot: limits_answer(robot) for robot in read_limits()})
        return 0
    if chosen.fresh:
        chosen.results.unlink(missing_ok=True)
    known, cases = read_results(chosen.results), chosen_cases(chosen)
    if not chosen.so_far:
        known = run_all(cases, known, chosen)
    lines = [known[case.key] for case in cases if case.key in known]
    for line in lines:
        if 'unmade' in line:
            print(f'{line["key"]}: left out, its arm is {line["unmade"]}')
    report([line for line in lines if 'unmade' not in line], chosen)
    return 0


if __name__ == '__main__':
    sys.exit(main())
