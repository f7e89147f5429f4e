"""The bank's picture: power over size, stated against right, confusion matrix."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bank import score
from bank.groups import of_kind, SIMULATORS, sized
from bank.score import Line
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np


def write_picture(path: Path, lines: Sequence[Line]) -> None:
    """Draw the three panels."""
    hidden, columns, counts = score.confusion(of_kind(lines, 'one', 'clean'))
    figure = Figure(figsize=(0.3 * len(columns) + 3.0, 0.26 * len(hidden) + 6.0),
                    layout='constrained')
    FigureCanvasAgg(figure)
    panels: Any = figure.subfigures(2, 1, height_ratios=(3.4, 0.26 * len(hidden) + 2.6))
    above, below = panels
    left, right = above.subplots(1, 2)
    _power(left, lines)
    _reliability(right, lines)
    _confusion(below.subplots(), hidden, columns, counts)
    figure.savefig(path, dpi=110)


def _power(axis: Any, lines: Sequence[Line]) -> None:
    for simulator, colour in zip(SIMULATORS, ('C0', 'C1')):
        for test, style, what in ((score.named, '--', 'any name'), (score.exact, '-', 'exact')):
            groups = [own for _, own in sized(lines, simulator) if own]
            sizes = [np.median([score.size_in_limits(line) for line in own]) for own in groups]
            shares = [score.share(own, test) for own in groups]
            ends = np.abs(np.array([share.interval for share in shares]).reshape(-1, 2).T
                          - [share.value for share in shares])
            axis.errorbar(sizes, [share.value for share in shares], ends, color=colour,
                          linestyle=style, capsize=2, label=f'{simulator}, {what}')
    axis.set(xscale='log', xlabel='size, detection limits', ylabel='share', ylim=(-0.02, 1.02))
    axis.set_xticks([1.0, 2.0, 4.0], ['1', '2', '4'])
    axis.minorticks_off()
    axis.legend(fontsize=7)


def _reliability(axis: Any, lines: Sequence[Line]) -> None:
    pairs = score.stated_probabilities(of_kind(lines, 'one', 'clean', 'missing', 'pair'))
    error, rows = score.calibration(pairs)
    axis.plot([0, 1], [0, 1], color='0.7')
    axis.plot([stated for stated, _, _ in rows], [right for _, right, _ in rows], 'o-')
    axis.set(xlabel='stated probability of a cause', ylabel='share right', xlim=(0, 1.02),
             ylim=(0, 1.02), title=f'calibration error {error:.3f}')


def _confusion(axis: Any, hidden: list[str], columns: list[str], counts: Any) -> None:
    shares = counts / counts.sum(axis=1, keepdims=True).clip(min=1)
    axis.imshow(shares, cmap='Blues', vmin=0.0, vmax=1.0, aspect='auto')
    for i, j in zip(*counts.nonzero()):
        axis.text(j, i, counts[i, j], ha='center', va='center', fontsize=7,
                  color='white' if shares[i, j] > 0.6 else 'black')
    axis.set_xticks(range(len(columns)), [name.replace('_', ' ') for name in columns],
                    rotation=90, fontsize=8)
    axis.set_yticks(range(len(hidden)), [name.replace('_', ' ') for name in hidden], fontsize=8)
    axis.set(xlabel='answered', ylabel='hidden')
