"""
How far an effect's form in nature is from the catalogue's: the share with the best log-score.

Cases of the bank's calibration, which never score: each is searched once, and the answer is then
read for each share `FORM` may be (see `log_odds_of`), 0 being a catalogue whose forms are
nature's. Printed for each: the mean log-score of a case over the catalogue, nats, of all cases
and of those that hide one effect, the error of calibration, the share of sure names that are
wrong. Last, what `IMITATED` counts: of effects taken out of the catalogue, how many others
explained so that nothing unnamed was left.

    python benchmarks/forms.py --count 46
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
import math
from pathlib import Path
import sys
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))

from bank import score  # noqa: E402
from bank.cases import all_cases, BankCase  # noqa: E402
from flex_plant_sim.diagnosis.causes.posterior import (  # noqa: E402
    judged,
    log_odds_of,
    Posterior,
)
from flex_plant_sim.diagnosis.causes.search import search  # noqa: E402
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base  # noqa: E402
import numpy as np  # noqa: E402
from temper import data_of  # noqa: E402
from truth.effects import CATALOGUE  # noqa: E402

FORMS = (0.0, 0.03, 0.05, 0.07, 0.1, 0.14, 0.2, 0.3)
# Those that name an effect, wrongly or rightly; with `ROBOT` alone, which is the quicker one.
KINDS, ROBOT = ('one', 'missing', 'pair'), 'reference'


def searched(case: BankCase) -> Posterior:
    """Return the posterior that a case's search ends with."""
    data, robot, _ = data_of(case)
    paper = '--model' in case.options
    nominal = nominal_base(robot, 'paper' if paper else 'assumed_modes', 1 if paper else 3,
                           '--no-coriolis' not in case.options)
    exclude = case.names if case.kind == 'missing' else ()
    return search(data, nominal, 1, lambda step, share: None, exclude).posterior


def with_form(found: Posterior, form: float) -> Posterior:
    """Return a posterior as it is with another share."""
    fits = [fit for fit in found.fits if not fit.discrepancy.more]
    top = np.max(log_odds_of([one for fit in fits for one in judged(fit)], found.nominal))
    promised = {labels: top + math.log(max(p / found.probability[0], 1e-300))
                for labels, p in found.unfitted.items()}
    return Posterior.of(fits, found.nominal, promised, form)


def line(case: BankCase, found: Posterior) -> dict[str, Any]:
    """Return what the bank's scores ask of an answer."""
    named = {h.effect.identifier for h in found.best.hypotheses}
    told = {name: found.of_effect(name) for name in CATALOGUE}
    return {'kind': case.kind, 'names': list(case.hidden), 'form': case.realisation.form,
            'probabilities': told,
            'causes': [{'name': name, 'probability': told[name]} for name in sorted(named)]}


def row(form: float, answers: list[tuple[BankCase, Posterior]]) -> str:
    """Return a line of the table."""
    lines = [line(case, with_form(found, form)) for case, found in answers]
    scores = [score.log_score(one) for one in lines]
    alone = [s for s, one in zip(scores, lines) if one['kind'] == 'one']
    told = score.stated_probabilities(lines)
    sure = [right for p, right in told if p >= score.SURE]
    wrong = f'{len(sure) - sum(sure)} of {len(sure)}'
    return (f'{form:<8g}{np.mean(scores):>10.2f}{np.mean(alone) if alone else math.nan:>12.2f}'
            f'{score.calibration(told)[0]:>14.3f}   {wrong}')


def imitated(answers: list[tuple[BankCase, Posterior]]) -> tuple[int, int]:
    """Return how many effects taken out were explained whole, and how many were taken out."""
    best = [found.best for case, found in answers if case.kind == 'missing']
    whole = [bool(fit.hypotheses) and not (fit.discrepancy.more or fit.discrepancy.far)
             for fit in best]
    return sum(whole), len(whole)


def chosen(count: int, rounds: int, only: str) -> Iterator[BankCase]:
    """Return the first cases whose key contains `only`."""
    some = (case for case in all_cases('calibration', rounds)
            if case.kind in KINDS and case.robot == ROBOT and only in case.key)
    for case, _ in zip(some, range(count)):
        yield case


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--count', type=int, default=8, help='cases, 15 s of CPU each')
    parser.add_argument('--rounds', type=int, default=9, help='rounds of the bank to draw from')
    parser.add_argument('--only', default='', help='cases whose name contains this')
    asked = parser.parse_args()
    answers = []
    for case in chosen(asked.count, asked.rounds, asked.only):
        answers.append((case, searched(case)))
        print(f'{case.key}: {sorted(h.label for h in answers[-1][1].best.hypotheses)}', flush=True)
    print('form     log-score   one effect   calibration   sure and wrong')
    for form in FORMS:
        print(row(form, answers))
    print('taken out of the catalogue, explained whole: {} of {}'.format(*imitated(answers)))
    return 0


if __name__ == '__main__':
    sys.exit(main())
