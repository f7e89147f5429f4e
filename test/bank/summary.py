"""The bank's report: the first part of docs/bank.md."""

from __future__ import annotations

from collections.abc import Sequence
import math
import statistics

from bank import groups, score
from bank.cases import FIRST_SEED
from bank.groups import of_kind
from bank.run import TRACEBACK
from bank.score import Line, Share


def figures(lines: Sequence[Line]) -> list[tuple[str, str, str, bool | None]]:
    """Return (what, demanded, measured, met or None) rows."""
    one, clean = of_kind(lines, 'one'), of_kind(lines, 'clean')
    missing, pair = of_kind(lines, 'missing'), of_kind(lines, 'pair')
    poor = of_kind(lines, 'poor')
    fair = [line for line in one if score.at_least(line, 4.0)]
    small = [line for line in one if not score.at_least(line, 2.0)]
    rows = [
        _at_least('exact name at 4 limits and more', 0.90, score.share(fair, score.exact)),
        _at_least('in a stated set of at most 3 at 4 limits and more', 0.97,
                  score.share(fair, score.in_small_set)),
        _at_most('below 2 limits: surely wrong', 0.0, score.share(small, score.surely_wrong)),
        _told('at all sizes: surely wrong', score.share(one, score.surely_wrong)),
        _at_most('clean arms: any name or `unknown`', 0.03,
                 score.share(clean, score.not_left_alone)),
        _at_least('effect missing from the catalogue: doubt stated or law drawn', 0.85,
                  score.share(missing, score.doubt_stated)),
        _at_most('effect missing from the catalogue: surely wrong', 0.03,
                 score.share(missing, score.surely_wrong)),
        _told('effect missing from the catalogue: others explain it whole',
              score.share(missing, score.imitated)),
        _at_least('pairs: both named', 0.80, score.share(pair, score.all_named)),
        _at_most('pairs: a wrong third', 0.05, score.share(pair, score.one_too_many)),
        _told('pairs: any name but the two', score.share(pair, score.named_wrongly)),
        _told('arm at rest: `data_cannot_answer`', score.share(
            [line for line in poor if line['seed'] % 2],
            lambda line: line.get('verdict') == 'data_cannot_answer')),
        _told('one joint moves: no wrong name', score.share(
            [line for line in poor if not line['seed'] % 2],
            lambda line: all(score.is_hidden(line, name) for name in score.named(line)))),
        _told('negative controls: no name stated surely', score.share(
            of_kind(lines, 'control'),
            lambda line: not score.named(line) or score.doubtful(line))),
        _at_most('ended in a traceback', 0.0, score.share(
            lines, lambda line: line['code'] == TRACEBACK)),
        _told('site right where the name is', score.share(
            [line for line in one if score.exact(line)], score.right_site))]
    return rows + _probability_rows(lines)


# Kinds of cases whose stated probabilities are scored.
JUDGED = ('one', 'clean', 'missing', 'pair')


def _probability_rows(lines: Sequence[Line]) -> list[tuple[str, str, str, bool | None]]:
    judged = of_kind(lines, *JUDGED)
    pairs = score.stated_probabilities(judged)
    error, _ = score.calibration(pairs)
    chance = ' (mean {:.3f}, 95 % below {:.3f} were all right)'.format(
        *score.calibration_by_chance(pairs)) if pairs else ''
    held, _ = score.coverage(of_kind(lines, 'one', 'pair'))
    return [('calibration error of the stated probability', '<= 0.05', f'{error:.3f}{chance}',
             None if math.isnan(error) else error <= 0.05),
            ('mean log-score of a case, nats', '', mean_log_score(judged), None),
            ('parameter intervals that hold the truth', '90 to 98 %', str(held),
             None if not held.total else 0.90 <= held.value <= 0.98)]


def mean_log_score(lines: Sequence[Line]) -> str:
    """Return the mean log-score of some cases with its standard error."""
    if not lines:
        return 'no case'
    scores = [score.log_score(line) for line in lines]
    spread = statistics.stdev(scores) / math.sqrt(len(scores)) if len(scores) > 1 else math.nan
    return f'{statistics.fmean(scores):.2f} +- {spread:.2f}'


def paired(lines: Sequence[Line], others: Sequence[Line]) -> str:
    """Return the mean log-score of the cases that both have, and the paired difference."""
    earlier = {line['key']: line for line in others if line['kind'] in JUDGED}
    shared = [line for line in lines if line['key'] in earlier]
    before = [earlier[line['key']] for line in shared]
    gains = [score.log_score(a) - score.log_score(b) for a, b in zip(shared, before)]
    if len(gains) < 2:
        return f'{len(gains)} cases in common: nothing to compare'
    error = statistics.stdev(gains) / math.sqrt(len(gains))
    return (f'{len(gains)} cases in common: log-score {mean_log_score(shared)}, of the other run '
            f'{mean_log_score(before)}, gain {statistics.fmean(gains):+.2f} +- {error:.2f}; exact '
            f'{score.share(shared, score.exact).right} against '
            f'{score.share(before, score.exact).right}, surely wrong '
            f'{score.share(shared, score.surely_wrong).right} against '
            f'{score.share(before, score.surely_wrong).right}')


def _at_least(what: str, demand: float, found: Share) -> tuple[str, str, str, bool | None]:
    met = None if not found.total else found.value >= demand
    return what, f'>= {100 * demand:.0f} %', str(found), met


def _at_most(what: str, demand: float, found: Share) -> tuple[str, str, str, bool | None]:
    met = None if not found.total else found.value <= demand
    return what, f'<= {100 * demand:.0f} %', str(found), met


def _told(what: str, found: Share) -> tuple[str, str, str, bool | None]:
    return what, '', str(found), None


HOW_IT_IS_MADE = f"""\
How often is `flex_diagnose` right? Records of arms with a hidden effect are made and judged:

- **Two simulators** that share no dynamics code with the fit make them: finite elements and a
  chain of rigid segments in MuJoCo (`test/truth`).
- **Arms.** Parts of one half are off by about 1 % (`good`), those of the other half as far as the
  robot's file says that they may be (`told`; `test/truth/tolerances.py`). All have coloured and
  quantised noise, and two further effects of half a detection limit.
- **Forms.** Nature gives each effect in one of its forms (`FORMS_OF` in `test/bank/cases.py`).
- **Sizes** are in detection limits of a clean record (`test/bank/limits.json`): 1, 2 and 4, as far
  as a size can be reached. Stribeck friction is as large as all of it near rest, by the limit of
  dry friction; what parts the two, its extra, may be much less.
- **Truncation.** Where `modal_truncation` is hidden the model is that of the paper, which leaves
  out Coriolis forces too: both are to be named.
- **Told** are the robot file and the payload that the operator believes in.
- **Surely** means a name stated from {score.SURE:g} on. Intervals are Wilson's, 95 %."""


def text(lines: Sequence[Line], commit: str, picture: str | None = None) -> str:
    """Return the report as Markdown; `commit` names the code that was judged."""
    parts = ['# Bank of hidden effects', '', f'Made by `make bank` with commit {commit}.', '',
             HOW_IT_IS_MADE, '', f'{len(lines)} cases. Seeds: {_seeds(lines)}.', '',
             '| | demanded | measured | |', '|---|---|---|---|']
    parts += [f'| {what} | {demand} | {found} | {_mark(met)} |'
              for what, demand, found, met in figures(lines)]
    for section in (groups.by_form, groups.by_spread, groups.by_size, groups.by_name,
                    _calibration_table, _wrong, _time_line):
        parts += ['', *section(lines)]
    if picture:
        parts += ['', f'![Power, stated probability and confusion matrix]({picture})']
    return '\n'.join(parts) + '\n'


def _seeds(lines: Sequence[Line]) -> str:
    for use, first in sorted(FIRST_SEED.items(), key=lambda item: -item[1]):
        if lines and all(line['seed'] >= first for line in lines):
            return f'{use}, from {first} on'
    return 'none'


def _mark(met: bool | None) -> str:
    return '' if met is None else ('met' if met else '**missed**')


def _calibration_table(lines: Sequence[Line]) -> list[str]:
    judged = of_kind(lines, *JUDGED)
    _, rows = score.calibration(score.stated_probabilities(judged))
    return ['## Stated probability', '', '| stated | right | causes |', '|---|---|---|',
            *(f'| {stated:.2f} | {right:.2f} | {count} |' for stated, right, count in rows)]


def _wrong(lines: Sequence[Line]) -> list[str]:
    """Return a list of the other cases that went wrong, so that they can be looked at."""
    tests = {'clean': lambda line: not score.named(line), 'missing': score.doubt_stated,
             'pair': score.all_named}
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
    """Return the confusion matrix as text, without what does not occur."""
    hidden, columns, counts = score.confusion(of_kind(lines, 'one', 'clean'))
    rows = []
    for name, row in zip(hidden, counts):
        answers = ', '.join(f'{columns[k]} {row[k]}' for k in row.argsort()[::-1] if row[k])
        right = row[columns.index(name)] if name in columns else row[
            columns.index('nothing_wrong')] if 'nothing_wrong' in columns else 0
        rows.append(f'{name:<22} {Share(int(right), int(row.sum()))!s:<34} {answers}')
    return '\n'.join(rows)
