"""The bank's report: docs/bank.md and the confusion matrix as a picture."""

from __future__ import annotations

from collections.abc import Sequence
import math
from pathlib import Path
import statistics
from typing import Any

from bank import score
from bank.score import Line, Share


def of_kind(lines: Sequence[Line], *kinds: str) -> list[Line]:
    """Return the lines of some kinds."""
    return [line for line in lines if line['kind'] in kinds]


def figures(lines: Sequence[Line]) -> list[tuple[str, str, str, bool | None]]:
    """Return (what, demanded, measured, met or None) rows."""
    one, clean = of_kind(lines, 'one'), of_kind(lines, 'clean')
    missing, poor = of_kind(lines, 'missing'), of_kind(lines, 'poor')
    fair = [line for line in one if score.large_enough(line)]
    rows = [
        _at_least('exact name', 0.90, score.share(fair, score.exact)),
        _at_least('name in a stated set of at most 3', 0.97,
                  score.share(fair, score.in_small_set)),
        _told('exact name of effects that cannot be made three detection limits large',
              score.share([line for line in one if line not in fair], score.exact)),
        _at_most('clean arms: any name', 0.03, score.share(clean, score.named)),
        _at_least('effect missing from the catalogue: unknown, or a look-alike with doubt', 0.80,
                  score.share(missing, score.unknown_recognised)),
        _at_most('effect missing from the catalogue: confidently wrong', 0.05,
                 score.share(missing, score.confidently_wrong)),
        _at_least('pairs: both named', 0.75,
                  score.share(of_kind(lines, 'pair'), score.both_named)),
        _told('look-alikes at half size: name in a stated set of at most 3',
              score.share(of_kind(lines, 'look_alike'), score.in_small_set)),
        _told('arm at rest: `data_cannot_answer`', score.share(
            [line for line in poor if line['seed'] % 2],
            lambda line: line.get('verdict') == 'data_cannot_answer')),
        _told('one joint moves: no wrong name', score.share(
            [line for line in poor if not line['seed'] % 2],
            lambda line: set(score.named(line)) <= set(line['names']))),
        _told('negative controls: no name stated surely', score.share(
            of_kind(lines, 'control'),
            lambda line: not score.named(line) or score.doubtful(line))),
        _told('site right where the name is', score.share(
            [line for line in one if score.exact(line)], score.right_site))]
    return rows + _probability_rows(lines)


def _probability_rows(lines: Sequence[Line]) -> list[tuple[str, str, str, bool | None]]:
    judged = of_kind(lines, 'one', 'clean', 'missing', 'pair', 'look_alike')
    error, _ = score.calibration(score.stated_probabilities(judged))
    held, _ = score.coverage(of_kind(lines, 'one', 'pair', 'look_alike'))
    return [('calibration error of the stated probability', '<= 0.05', f'{error:.3f}',
             None if math.isnan(error) else error <= 0.05),
            ('parameter intervals that hold the truth', '90 to 98 %', str(held),
             None if not held.total else 0.90 <= held.value <= 0.98)]


def _at_least(what: str, demand: float, found: Share) -> tuple[str, str, str, bool | None]:
    met = None if not found.total else found.value >= demand
    return what, f'>= {100 * demand:.0f} %', str(found), met


def _at_most(what: str, demand: float, found: Share) -> tuple[str, str, str, bool | None]:
    met = None if not found.total else found.value <= demand
    return what, f'<= {100 * demand:.0f} %', str(found), met


def _told(what: str, found: Share) -> tuple[str, str, str, bool | None]:
    return what, '', str(found), None


def text(lines: Sequence[Line], picture: str | None = None) -> str:
    """Return the report as Markdown."""
    parts = ['# Bank of hidden effects', '',
             'Made by `make bank`. A finite-element arm with part tolerances, coloured and '
             'quantised noise and two further effects of half a detection limit (`test/truth`, '
             'no code shared with the fit) makes each record; `flex_diagnose` gets the file and '
             'the payload that the operator believes in. Hidden effects are at least three '
             "detection limits in size. Intervals are Wilson's, 95 %.", '',
             f'{len(lines)} cases.', '',
             '| | demanded | measured | |', '|---|---|---|---|']
    parts += [f'| {what} | {demand} | {found} | {_mark(met)} |'
              for what, demand, found, met in figures(lines)]
    parts += ['', *_by_name(lines), '', *_calibration_table(lines), '', *_wrong(lines), '',
              *_time_line(lines)]
    if picture:
        parts += ['', f'![Confusion matrix of the single effects]({picture})']
    return '\n'.join(parts) + '\n'


def _mark(met: bool | None) -> str:
    return '' if met is None else ('met' if met else '**missed**')


def _by_name(lines: Sequence[Line]) -> list[str]:
    rows = ['## By effect', '', '| hidden | robot | exact | in a set of at most 3 | '
            'intervals that hold the truth | answered instead |', '|---|---|---|---|---|---|']
    one = of_kind(lines, 'one')
    for name, robot in sorted({(line['names'][0], line['robot']) for line in one}):
        own = [line for line in one if line['names'] == [name] and line['robot'] == robot]
        right, small = (score.share(own, test) for test in (score.exact, score.in_small_set))
        held, _ = score.coverage(own)
        instead = sorted({'+'.join(score.named(line)) or str(line.get('verdict', 'failed'))
                          for line in own if not score.exact(line)})
        rows.append(f'| `{name}` | {robot} | {right.right} of {right.total} | '
                    f'{small.right} of {small.total} | {held.right} of {held.total} | '
                    f'{", ".join(instead)} |')
    return rows


def _calibration_table(lines: Sequence[Line]) -> list[str]:
    judged = of_kind(lines, 'one', 'clean', 'missing', 'pair', 'look_alike')
    _, rows = score.calibration(score.stated_probabilities(judged))
    return ['## Stated probability', '', '| stated | right | causes |', '|---|---|---|',
            *(f'| {stated:.2f} | {right:.2f} | {count} |' for stated, right, count in rows)]


def _wrong(lines: Sequence[Line]) -> list[str]:
    """Return every other case that went wrong, so that it can be looked at."""
    tests = {'clean': lambda line: not score.named(line), 'missing': score.unknown_recognised,
             'pair': score.both_named, 'look_alike': score.in_small_set}
    rows = ['## Other cases that went wrong', '', '| case | verdict | named |', '|---|---|---|']
    for line in lines:
        if line['kind'] in tests and not tests[line['kind']](line):
            names = ', '.join(f'{c["name"]} {c["probability"]:.2f}'
                              for c in line.get('causes', []))
            rows.append(f'| `{line["key"]}` | {line.get("verdict", line["complaint"])} '
                        f'| {names} |')
    return rows


def _time_line(lines: Sequence[Line]) -> list[str]:
    found = []
    for robot in sorted({line['robot'] for line in lines}):
        seconds = [line['seconds'] for line in lines if line['robot'] == robot]
        found.append(f'{robot}: {len(seconds)} diagnoses of 40 s logs, one process each, '
                     f'median {statistics.median(seconds):.0f} s, longest {max(seconds):.0f} s.')
    return found


def terminal_matrix(lines: Sequence[Line]) -> str:
    """Return the confusion matrix as text: only what occurs."""
    hidden, columns, counts = score.confusion(of_kind(lines, 'one', 'clean'))
    rows = []
    for name, row in zip(hidden, counts):
        answers = ', '.join(f'{columns[k]} {row[k]}' for k in row.argsort()[::-1] if row[k])
        right = row[columns.index(name)] if name in columns else row[
            columns.index('nothing_wrong')] if 'nothing_wrong' in columns else 0
        rows.append(f'{name:<22} {Share(int(right), int(row.sum()))!s:<34} {answers}')
    return '\n'.join(rows)


def write_picture(path: Path, lines: Sequence[Line]) -> None:
    """Draw the confusion matrix of the single effects and the clean arms."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    hidden, columns, counts = score.confusion(of_kind(lines, 'one', 'clean'))
    shares = counts / counts.sum(axis=1, keepdims=True).clip(min=1)
    figure = Figure(figsize=(0.3 * len(columns) + 3.0, 0.26 * len(hidden) + 2.6),
                    layout='constrained')
    FigureCanvasAgg(figure)
    axis: Any = figure.subplots()
    axis.imshow(shares, cmap='Blues', vmin=0.0, vmax=1.0, aspect='auto')
    for i, j in zip(*counts.nonzero()):
        axis.text(j, i, counts[i, j], ha='center', va='center', fontsize=7,
                  color='white' if shares[i, j] > 0.6 else 'black')
    axis.set_xticks(range(len(columns)), [name.replace('_', ' ') for name in columns],
                    rotation=90, fontsize=8)
    axis.set_yticks(range(len(hidden)), [name.replace('_', ' ') for name in hidden], fontsize=8)
    axis.set_xlabel('answered')
    axis.set_ylabel('hidden')
    figure.savefig(path, dpi=120)
