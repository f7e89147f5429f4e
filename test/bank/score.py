"""Scores of answers: names, sets, false alarms, stated probabilities, intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

from bank.cases import LOOK_ALIKES
from bank.sizes import TIMES_LIMIT
import numpy as np

Z = 1.959964
LARGEST_SET = 3
SURE = 0.9
BINS = 5

Line = dict[str, Any]


@dataclass(frozen=True)
class Share:
    """How many of how many, with Wilson's 95 % interval (JASA 22 (1927))."""

    right: int
    total: int

    @property
    def value(self) -> float:
        """Return the share; NaN of none."""
        return self.right / self.total if self.total else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Return low and high."""
        if not self.total:
            return 0.0, 1.0
        n, p = self.total, self.value
        centre = (p + Z * Z / (2 * n)) / (1 + Z * Z / n)
        half = Z / (1 + Z * Z / n) * math.sqrt(p * (1 - p) / n + Z * Z / (4 * n * n))
        return max(0.0, centre - half), min(1.0, centre + half)

    def __str__(self) -> str:
        """Return 90 % (80 to 95 %), 45 of 50."""
        if not self.total:
            return 'no case'
        low, high = self.interval
        return (f'{100 * self.value:.1f} % ({100 * low:.0f} to {100 * high:.0f} %), '
                f'{self.right} of {self.total}')


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


def exact(line: Line) -> bool:
    """Tell whether exactly what is hidden was named as cause."""
    return sorted(named(line)) == sorted(line['names'])


def in_small_set(line: Line) -> bool:
    """Tell whether what is hidden is named, or in a stated set of at most three."""
    names = stated_set(line)
    return exact(line) or (set(line['names']) <= names and len(names) <= LARGEST_SET)


def large_enough(line: Line) -> bool:
    """Tell whether what is hidden reaches three detection limits, as far as that is known."""
    return all(term['times_limit'] is None or term['times_limit'] >= TIMES_LIMIT
               for term in line['truth'])


def right_site(line: Line) -> bool:
    """Tell whether every named cause that is hidden acts where it was hidden."""
    sites = {cause['name']: cause['site'] for cause in line.get('causes', [])}
    return all(sites.get(term['name'], term['site']) == term['site'] for term in line['truth'])


def both_named(line: Line) -> bool:
    """Tell whether all that is hidden is among the causes."""
    return set(line['names']) <= set(named(line))


def look_alikes_of(name: str) -> set[str]:
    """Return what the bank declares to look like an effect."""
    return {other for group in LOOK_ALIKES if name in group for other in group} - {name}


def doubtful(line: Line) -> bool:
    """Tell whether the answer states doubt about its first cause."""
    causes = line.get('causes', [])
    return (line.get('verdict') in ('not_in_catalogue', 'cannot_tell', 'cause_and_remainder')
            or all(cause['probability'] < SURE for cause in causes))


def unknown_recognised(line: Line) -> bool:
    """Tell whether a missing effect is called unknown, or a look-alike named with doubt."""
    if line.get('verdict') == 'not_in_catalogue':
        return True
    names = named(line)
    alike = set().union(*(look_alikes_of(name) for name in line['names']))
    return bool(names) and names[0] in alike and doubtful(line)


def confidently_wrong(line: Line) -> bool:
    """Tell whether a name that is neither hidden nor a declared look-alike is stated surely."""
    names = named(line)
    if not names or doubtful(line):
        return False
    allowed = set(line['names']).union(*(look_alikes_of(name) for name in line['names']))
    return names[0] not in allowed


def share(lines: Sequence[Line], test: Any) -> Share:
    """Return how many lines pass a test."""
    return Share(sum(bool(test(line)) for line in lines), len(lines))


def stated_probabilities(lines: Sequence[Line]) -> list[tuple[float, bool]]:
    """Return each stated probability of a cause with whether that cause is hidden."""
    return [(cause['probability'], cause['name'] in line['names'])
            for line in lines for cause in line.get('causes', [])]


def calibration(pairs: Sequence[tuple[float, bool]]
                ) -> tuple[float, list[tuple[float, float, int]]]:
    """
    Return the expected calibration error and (mean stated, share right, count) per bin.

    Bins of equal count (Naeini, Cooper and Hauskrecht, AAAI 2015).
    """
    if not pairs:
        return math.nan, []
    ordered = sorted(pairs)
    rows = []
    for part in np.array_split(np.arange(len(ordered)), min(BINS, len(ordered))):
        chosen = [ordered[k] for k in part]
        rows.append((float(np.mean([p for p, _ in chosen])),
                     float(np.mean([right for _, right in chosen])), len(chosen)))
    error = sum(abs(stated - right) * count for stated, right, count in rows) / len(pairs)
    return error, rows


def coverage(lines: Sequence[Line]) -> tuple[Share, list[tuple[str, str, bool]]]:
    """Return how often a stated interval holds the truth, for rightly named causes and sites."""
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
    names = named(line)
    if line['code'] != 0:
        return 'failed'
    if len(names) == 1:
        return names[0]
    return 'several' if names else str(line['verdict'])
