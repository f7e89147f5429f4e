"""Scores of the answers: names, sets, false alarms, stated probabilities and intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

from bank.cases import ALSO_RIGHT
import numpy as np
from truth.effects import CATALOGUE

Z = 1.959964
# Names in a stated set that still counts as an answer.
LARGEST_SET = 3
# Probability from which a cause is stated surely: none is stated at more than 0.88.
SURE = 0.8
# Bins of the calibration error, and random draws for what it would be by chance.
BINS = 5
DRAWS = 2000
# Share of a number of detection limits from which a size counts as that number.
NEARLY = 0.9
# Probability that the log-score gives to a name that an answer does not mention.
UNMENTIONED = 0.001

Line = dict[str, Any]


@dataclass(frozen=True)
class Share:
    """A count out of a total, with Wilson's 95 % interval (JASA 22 (1927))."""

    right: int
    total: int

    @property
    def value(self) -> float:
        """Return the share; NaN where the total is zero."""
        return self.right / self.total if self.total else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Return the interval's low and high end."""
        if not self.total:
            return 0.0, 1.0
        n, p = self.total, self.value
        centre = (p + Z * Z / (2 * n)) / (1 + Z * Z / n)
        half = Z / (1 + Z * Z / n) * math.sqrt(p * (1 - p) / n + Z * Z / (4 * n * n))
        return max(0.0, centre - half), min(1.0, centre + half)

    def __str__(self) -> str:
        """Return the share in words, as in '90 % (80 to 95 %), 45 of 50'."""
        if not self.total:
            return 'no case'
        low, high = self.interval
        return (f'{100 * self.value:.1f} % ({100 * low:.0f} to {100 * high:.0f} %), '
                f'{self.right} of {self.total}')


def not_left_alone(line: Line) -> bool:
    """Tell whether a clean arm got another verdict than nothing_wrong."""
    return bool(line.get('verdict') != 'nothing_wrong')


def named(line: Line) -> list[str]:
    """Return the names of the causes, the likeliest first."""
    causes = sorted(line.get('causes', []), key=lambda cause: -cause['probability'])
    return [cause['name'] for cause in causes]


def stated_set(line: Line) -> set[str]:
    """Return every name that the answer leaves possible."""
    names = set(named(line))
    for cause in line.get('causes', []):
        names |= {_identifier(label) for label in cause['look_alikes']}
    for group in line.get('cannot_tell', []):
        names |= {_identifier(label) for label in group}
    return names


def _identifier(label: str) -> str:
    return label.partition(':')[0]


def right_names(line: Line, name: str) -> set[str]:
    """Return the right names of a hidden effect in the form that it has."""
    also = ALSO_RIGHT.get((name, line['form']))
    return {name} if also is None else {name, also}


def is_hidden(line: Line, answer: str) -> bool:
    """Return whether a name is a right one of a hidden effect."""
    return any(answer in right_names(line, name) for name in line['names'])


def exact(line: Line) -> bool:
    """Return whether exactly the hidden effects are named as causes."""
    answers = named(line)
    return (len(answers) == len(line['names'])
            and all(is_hidden(line, answer) for answer in answers) and all_named(line))


def in_small_set(line: Line) -> bool:
    """Return whether the hidden effects are named, or in a stated set of at most three."""
    names = stated_set(line)
    return exact(line) or (len(names) <= LARGEST_SET and all(
        right_names(line, name) & names for name in line['names']))


def size_in_limits(line: Line) -> float:
    """Return the smallest hidden effect in detection limits; the intended size if unknown."""
    known = [term['times_limit'] for term in line['truth'] if term['times_limit'] is not None]
    return float(min(known, default=line['size']))


def at_least(line: Line, limits: float) -> bool:
    """Return whether the hidden effects are of a number of detection limits or larger."""
    return size_in_limits(line) >= NEARLY * limits


def right_site(line: Line) -> bool:
    """Return whether every rightly named cause has the right site."""
    sites = {cause['name']: cause['site'] for cause in line.get('causes', [])}
    return all(sites.get(term['name'], term['site']) == term['site'] for term in line['truth'])


def all_named(line: Line) -> bool:
    """Return whether all hidden effects are among the causes."""
    return all(right_names(line, name) & set(named(line)) for name in line['names'])


def doubtful(line: Line) -> bool:
    """Return whether the answer states doubt: in its verdict, or in every cause's probability."""
    causes = line.get('causes', [])
    return (line.get('verdict') in ('not_in_catalogue', 'cannot_tell', 'cause_and_remainder')
            or all(cause['probability'] < SURE for cause in causes))


def surely_wrong(line: Line) -> bool:
    """Return whether a name is stated surely that is neither hidden nor a distractor."""
    return any(cause['probability'] >= SURE and not is_hidden(line, cause['name'])
               and cause['name'] not in line.get('distractors', [])
               for cause in line.get('causes', []))


def named_wrongly(line: Line) -> bool:
    """Return whether a cause is named that is not hidden, be it a distractor or not."""
    return any(not is_hidden(line, name) for name in named(line))


def one_too_many(line: Line) -> bool:
    """Return whether more is named than hidden, and one is neither hidden nor a distractor."""
    there = line.get('distractors', [])
    return len(named(line)) > len(line['names']) and any(
        not is_hidden(line, name) and name not in there for name in named(line))


def doubt_stated(line: Line) -> bool:
    """Return whether the answer says that something is wrong and doubts every name for it."""
    return line.get('verdict') != 'nothing_wrong' and doubtful(line)


def imitated(line: Line) -> bool:
    """Return whether the answer explains all by effects of the catalogue."""
    return line.get('verdict') in ('cause', 'cannot_tell')


def stated(line: Line) -> dict[str, float]:
    """
    Return the probability that the answer gives to each name of being a cause.

    It is taken from the answer's probabilities of all effects, or of sets of causes. An answer
    without these states the probabilities of its causes, and their look-alikes share the rest.
    """
    if line.get('probabilities'):
        return dict(line['probabilities'])
    found: dict[str, float] = {}
    for some in line.get('sets', []):
        for name in {_identifier(label) for label in some['causes']}:
            found[name] = found.get(name, 0.0) + some['probability']
    if line.get('sets'):
        return found
    for cause in line.get('causes', []):
        alike = {_identifier(label) for label in cause['look_alikes']} - {cause['name']}
        for name in alike:
            left = (1.0 - cause['probability']) / len(alike)
            found[name] = max(found.get(name, 0.0), left)
        found[cause['name']] = max(found.get(cause['name'], 0.0), cause['probability'])
    return found


def log_score(line: Line) -> float:
    """
    Return the log-score of the answer, nats, at most 0.

    It is the sum over the catalogue of ln of the probability that was stated of what is true; each
    name is a forecast of its own, a cause or not (Good, JRSS B 14 (1952)).
    """
    forecast, total = stated(line), 0.0
    hidden = set() if line['kind'] in ('missing', 'control') else set(line['names'])
    for name in CATALOGUE:
        p = float(np.clip(forecast.get(name, 0.0), UNMENTIONED, 1.0 - UNMENTIONED))
        if name in hidden and name not in forecast:
            p = max([p, *(forecast.get(other, 0.0) for other in right_names(line, name))])
        elif name not in hidden and hidden and is_hidden(line, name):
            continue
        total += math.log(p if name in hidden else 1.0 - p)
    return total


def share(lines: Sequence[Line], test: Any) -> Share:
    """Return how many lines pass a test."""
    return Share(sum(bool(test(line)) for line in lines), len(lines))


def stated_probabilities(lines: Sequence[Line]) -> list[tuple[float, bool]]:
    """Return each stated probability of a cause with whether that cause is hidden."""
    return [(cause['probability'], is_hidden(line, cause['name']) and line['kind'] != 'missing')
            for line in lines for cause in line.get('causes', [])]


def calibration(pairs: Sequence[tuple[float, bool]]
                ) -> tuple[float, list[tuple[float, float, int]]]:
    """
    Return the expected calibration error and (mean stated, share right, count) per bin.

    Bins of equal count (Naeini, Cooper and Hauskrecht, AAAI 2015).
    """
    if not pairs:
        return math.nan, []
    # A stable sort on the probability alone: among equal ones the right ones must not come last.
    ordered = sorted(pairs, key=lambda pair: pair[0])
    rows = []
    for part in np.array_split(np.arange(len(ordered)), min(BINS, len(ordered))):
        chosen = [ordered[k] for k in part]
        rows.append((float(np.mean([p for p, _ in chosen])),
                     float(np.mean([right for _, right in chosen])), len(chosen)))
    error = sum(abs(stated - right) * count for stated, right, count in rows) / len(pairs)
    return error, rows


def calibration_by_chance(pairs: Sequence[tuple[float, bool]], seed: int = 0
                          ) -> tuple[float, float]:
    """Return mean and 95 % quantile of the calibration error if all probabilities were right."""
    rng = np.random.default_rng(seed)
    drawn = [calibration([(p, bool(rng.random() < p)) for p, _ in pairs])[0]
             for _ in range(DRAWS)]
    return float(np.mean(drawn)), float(np.quantile(drawn, 0.95))


def coverage(lines: Sequence[Line]) -> tuple[Share, list[tuple[str, str, bool]]]:
    """Return the coverage of intervals, for rightly named causes and sites, and its rows."""
    rows = []
    for line in lines:
        for term in line['truth']:
            for cause in line.get('causes', []):
                if (cause['name'], cause['site']) != (term['name'], term['site']):
                    continue
                rows += [(term['name'], key, value['low'] <= term['values'][key] <= value['high'])
                         for key, value in cause['parameters'].items() if key in term['values']]
    return Share(sum(row[2] for row in rows), len(rows)), rows


def confusion(lines: Sequence[Line]) -> tuple[list[str], list[str], Any]:
    """Return hidden names, answered names and counts (hidden, answered) of single effects."""
    answers = [(line['names'][0] if line['names'] else 'nothing', _answered(line))
               for line in lines]
    hidden = sorted({name for name, _ in answers}, key=lambda name: (name == 'nothing', name))
    special = ('nothing_wrong', 'not_in_catalogue', 'data_cannot_answer', 'several', 'failed')
    columns = sorted({answer for _, answer in answers} | set(hidden) - {'nothing'},
                     key=lambda name: (name in special, name))
    counts = np.zeros((len(hidden), len(columns)), dtype=int)
    for name, answer in answers:
        counts[hidden.index(name), columns.index(answer)] += 1
    return hidden, columns, counts


def _answered(line: Line) -> str:
    """Return the column of the confusion matrix: a name, `several`, a verdict or `failed`."""
    names = named(line)
    if line['code'] != 0:
        return 'failed'
    if len(names) == 1:
        return names[0]
    return 'several' if names else str(line['verdict'])
