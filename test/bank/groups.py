"""Tables of the bank's report: by form in nature, by size, by name."""

from __future__ import annotations

from collections.abc import Sequence

from bank import score
from bank.score import Line

SIMULATORS = ('finite_elements', 'mujoco')
# Edges of the sizes' groups, in detection limits; each holds the size that cases ask for.
SIZE_EDGES = (0.0, 0.5, 1.5, 3.0, 100.0)


def of_kind(lines: Sequence[Line], *kinds: str) -> list[Line]:
    """Return the lines of some kinds."""
    return [line for line in lines if line['kind'] in kinds]


def sized(lines: Sequence[Line], simulator: str = '') -> list[tuple[str, list[Line]]]:
    """Return single effects by size, the smallest first, of one simulator or of all."""
    one = [line for line in of_kind(lines, 'one') if simulator in ('', line['simulator'])]
    return [(f'{low:g} to {high:g}', [line for line in one
                                      if low <= score.size_in_limits(line) < high])
            for low, high in zip(SIZE_EDGES, SIZE_EDGES[1:])]


def by_form(lines: Sequence[Line]) -> list[str]:
    """Return the table over simulators and forms."""
    rows = ['## By form in nature', '', 'Forms marked * may be tuned on; the others never are.',
            '', '| simulator | form | exact | in a set of at most 3 | surely wrong |',
            '|---|---|---|---|---|']
    one = of_kind(lines, 'one')
    forms = sorted({(line['simulator'], line['form'], line['calibration']) for line in one})
    for simulator, form, calibration in forms:
        own = [line for line in one if (line['simulator'], line['form']) == (simulator, form)]
        shares = [score.share(own, test)
                  for test in (score.exact, score.in_small_set, score.surely_wrong)]
        rows.append(f'| {simulator} | {form or "plain"}{" *" * calibration} | '
                    + ' | '.join(map(str, shares)) + ' |')
    return rows


def by_spread(lines: Sequence[Line]) -> list[str]:
    """Return the table over arms that are well made, and those as far off as their file says."""
    rows = ['## By how far parts are off', '', '| parts | exact | in a set of at most 3 | surely '
            'wrong | clean ones: any name or `unknown` |', '|---|---|---|---|---|']
    for spread in sorted({line['spread'] for line in lines}):
        own = [line for line in lines if line['spread'] == spread]
        shares = [*(score.share(of_kind(own, 'one'), test)
                    for test in (score.exact, score.in_small_set, score.surely_wrong)),
                  score.share(of_kind(own, 'clean'), score.not_left_alone)]
        rows.append(f'| {spread} | ' + ' | '.join(map(str, shares)) + ' |')
    return rows


def by_size(lines: Sequence[Line]) -> list[str]:
    """Return the power table."""
    rows = ['## By size', '', '| size in detection limits | simulator | any name | exact | '
            'in a set of at most 3 | surely wrong |', '|---|---|---|---|---|---|']
    for simulator in SIMULATORS:
        for size, own in sized(lines, simulator):
            if own:
                shares = [score.share(own, test) for test in (
                    score.named, score.exact, score.in_small_set, score.surely_wrong)]
                rows.append(f'| {size} | {simulator} | ' + ' | '.join(map(str, shares)) + ' |')
    return rows


def by_name(lines: Sequence[Line]) -> list[str]:
    """Return the table over hidden effects."""
    rows = ['## By effect', '', '| hidden | robot | exact | in a set of at most 3 | '
            'intervals that hold the truth | answered instead (form, size) |',
            '|---|---|---|---|---|---|']
    one = of_kind(lines, 'one')
    for name, robot in sorted({(line['names'][0], line['robot']) for line in one}):
        own = [line for line in one if line['names'][0] == name and line['robot'] == robot]
        right, small = (score.share(own, test) for test in (score.exact, score.in_small_set))
        held, _ = score.coverage(own)
        instead = [f'{"+".join(score.named(line)) or line.get("verdict", "failed")} '
                   f'({line["form"] or line["simulator"]}, {score.size_in_limits(line):.1f})'
                   for line in own if not score.exact(line)]
        rows.append(f'| `{name}` | {robot} | {right.right} of {right.total} | '
                    f'{small.right} of {small.total} | {held.right} of {held.total} | '
                    f'{", ".join(instead)} |')
    return rows
