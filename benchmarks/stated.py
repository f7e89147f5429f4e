"""
Fit the odds that something unknown looks like a set of causes, so that a named cause is not real.

The posterior over sets knows effects of the catalogue in the catalogue's forms. Nature has others,
which a set may imitate. The odds of that, and the factor by which each further fault that a set
needs raises them, are fitted by maximum likelihood to the bank's answers on calibration seeds.
Cases of each kind are weighted to be as frequent as a whole bank has them, and each case is left
out once to see what the fit is worth. Then other answers are scored with them: the calibration
error beside its mean if every stated probability were right.

    python test/run_bank.py --use calibration --rounds 1 --results build/odds.jsonl
    python test/run_bank.py --use calibration --rounds 7 --only missing --results build/odds.jsonl
    python test/run_bank.py --use calibration --rounds 7 --only pair/ --results build/odds.jsonl
    python benchmarks/stated.py build/odds.jsonl --score build/bank.jsonl
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
import sys

import _truths  # noqa: F401
from bank import score
from bank.summary import JUDGED
from flex_plant_sim.diagnosis.likelihood.prior import (
    further_faults,
    imitation_odds,
    MAX_FURTHER_FAULTS,
)
from flex_plant_sim.diagnosis.verdict.locked_part import PREDICTS_WORSE, WORSE_WHERE_NAMED
from flex_plant_sim.effects import catalogue
import numpy as np
from run_bank import read_results, RESULTS
from scipy.optimize import minimize

# What an answer says where something unnamed was found before the locked part was looked at.
REMAINS = 'Something unnamed remains.'
# Cases of a whole bank: three of every identifier, effects taken out, pairs, clean arms.
WHOLE_BANK = {'one': 3 * len(catalogue()), 'missing': 40, 'pair': 30, 'clean': 100}
# Label of the unknown.
UNKNOWN = 'unknown'


@dataclass(frozen=True)
class Claim:
    """A named cause: (probability, further faults) of each set with it; whether it is hidden."""

    case: str
    kind: str
    sets: tuple[tuple[float, int], ...]
    right: bool

    def probability(self, odds: float, factor: float) -> float:
        """Return the stated probability at given odds and factor for each further fault."""
        return sum(p / (1.0 + odds * factor**more) for p, more in self.sets)


def claims(line: score.Line) -> list[Claim]:
    """Return the causes that an answer names; sets not printed are taken to share alike."""
    printed = sum(some['probability'] for some in line['sets'])
    return [Claim(line['key'], line['kind'], tuple(
        (some['probability'] / printed, further(some['causes'])) for some in line['sets']
        if cause['name'] in {label.partition(':')[0] for label in some['causes']}),
        line['kind'] != 'missing' and score.is_hidden(line, cause['name']))
        for cause in line.get('causes', [])]


def further(labels: Sequence[str]) -> int:
    """Return the number of faults of a set beyond the ordinary ones."""
    named = [label for label in labels if label != UNKNOWN]
    return min(further_faults(named, UNKNOWN in labels), MAX_FURTHER_FAULTS)


def weights(lines: Sequence[score.Line]) -> dict[str, float]:
    """Return the weight of a case by kind, by which kinds are as frequent as in a whole bank."""
    found = [line['kind'] for line in lines]
    return {kind: WHOLE_BANK[kind] / found.count(kind) for kind in set(found)}


def log_likelihood(some: Sequence[Claim], weight: dict[str, float], logs: score.Any) -> float:
    """Return the log-likelihood of claims at (ln odds, ln factor), nats."""
    total = 0.0
    for claim in some:
        p = min(max(claim.probability(*np.exp(logs)), 1e-6), 1.0 - 1e-6)
        total += weight[claim.kind] * float(np.log(p if claim.right else 1.0 - p))
    return total


def likeliest(some: Sequence[Claim], weight: dict[str, float]) -> score.Any:
    """Find the logarithms of odds and factor that are likeliest, (2,)."""
    return minimize(lambda logs: -log_likelihood(some, weight, logs), np.array([-2.0, 1.0]),
                    method='Nelder-Mead').x


def left_out(some: Sequence[Claim], weight: dict[str, float]) -> score.Any:
    """Return the fits without each case in turn, (cases, 2), and the nats that case then gets."""
    cases = sorted({claim.case for claim in some})
    pairs = [likeliest([c for c in some if c.case != case], weight) for case in cases]
    nats = [log_likelihood([c for c in some if c.case == case], weight, pair)
            for case, pair in zip(cases, pairs)]
    return np.array(pairs), float(np.sum(nats))


def reweighed(line: score.Line, odds: float, factor: float) -> score.Line:
    """Return an answer with other odds; what is not named keeps its probability."""
    stated = [claim.probability(odds, factor) for claim in claims(line)]
    causes = [{**cause, 'probability': p} for cause, p in zip(line['causes'], stated)]
    named = {cause['name']: cause['probability'] for cause in causes}
    return {**line, 'causes': causes, 'probabilities': {**line['probabilities'], **named}}


def verdict(lines: Sequence[score.Line], what: str) -> str:
    """Return the scores in one line, with the calibration error that right forecasts have."""
    pairs = score.stated_probabilities(lines)
    chance, most = score.calibration_by_chance(pairs)
    brier = np.mean([(p - right)**2 for p, right in pairs])
    mean = np.mean([score.log_score(line) for line in lines])
    return (f'{what:<10} log-score {mean:.3f}  {len(pairs)} causes: calibration error '
            f'{score.calibration(pairs)[0]:.3f} (right ones: {chance:.3f}, 95 % below '
            f'{most:.3f})  Brier {brier:.3f}')


def refuted(lines: Sequence[score.Line]) -> str:
    """Return of how many sets, right and wrong, the locked part refutes."""
    found = {True: [0, 0], False: [0, 0]}
    for line in lines:
        if line['causes'] and REMAINS not in line['sentence']:
            right = line['kind'] != 'missing' and all(
                score.is_hidden(line, cause['name']) for cause in line['causes'])
            found[right][0] += any(said in line['sentence']
                                   for said in (PREDICTS_WORSE, WORSE_WHERE_NAMED))
            found[right][1] += 1
    return ', '.join(f'{"right" if right else "wrong"} {worse} of {count}'
                     for right, (worse, count) in found.items())


def judged(path: Path) -> list[score.Line]:
    """Return the answers of a file whose kind is scored."""
    return [line for line in read_results(path).values()
            if line['kind'] in JUDGED and line.get('sets')]


def main() -> int:
    """Print the odds, what the fit is worth, and the scores of other answers with them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('results', type=Path, nargs='?', default=RESULTS,
                        help='of calibration cases')
    parser.add_argument('--score', type=Path, help='results of other cases')
    chosen = parser.parse_args()
    if not chosen.results.is_file():
        print(f'{chosen.results.name}: no such results; `make bank` writes them')
        return 0
    lines = judged(chosen.results)
    some, weight = [claim for line in lines for claim in claims(line)], weights(lines)
    pair, (pairs, nats) = likeliest(some, weight), left_out(some, weight)
    # The jackknife's standard error.
    error = np.sqrt((len(pairs) - 1) * np.var(pairs, axis=0))
    total = sum(weight[claim.kind] for claim in some)
    print(f'locked part predicted worse: {refuted(lines)}')
    print(f'{len(lines)} cases, {len(some)} causes: odds {np.exp(pair[0]):.3g} (factor '
          f'{np.exp(error[0]):.2g} either way), for each further fault times '
          f'{np.exp(pair[1]):.3g} (factor {np.exp(error[1]):.2g})')
    present = log_likelihood(some, weight, np.log([
        imitation_odds(), imitation_odds(1) / imitation_odds()]))
    print(f'nats a cause, its case left out: {nats / total:.3f}; as the code has it: '
          f'{present / total:.3f}')
    if chosen.score:
        others = judged(chosen.score)
        print(verdict(others, 'as found'))
        print(verdict([reweighed(line, *np.exp(pair)) for line in others], 'with these'))
    return 0


if __name__ == '__main__':
    sys.exit(main())
