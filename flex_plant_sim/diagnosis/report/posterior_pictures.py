"""Pictures of the posterior: the sets of causes, and the parts that deviate most."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from flex_plant_sim.diagnosis.report.figures import AFTER, MEASURED, Picture, picture
from flex_plant_sim.diagnosis.verdict.results import PartEstimate
from flex_plant_sim.diagnosis.verdict.wording import (
    label_text,
    part_text,
    percent_text,
    set_text,
)
from flex_plant_sim.interval import Z95

# Largest numbers of sets and of parts in a picture.
SETS, PARTS = 8, 14
# Least probability that is shown: a smaller one rounds to 0 %.
LEAST_PROBABILITY = 0.005
# Deviation, in tolerances, from which a part is shown.
MOVED = 1.0
PRIOR = '#cfd8dc'


def sets_picture(sets: Sequence[tuple[tuple[str, ...], float]]) -> Picture:
    """Return the most probable sets of causes as bars."""
    shown = [(set_text(labels), p) for labels, p in sets[:SETS] if p >= LEAST_PROBABILITY] or [
        (set_text(labels), p) for labels, p in sets[:1]]

    def draw(figure: Any) -> None:
        figure.subplots_adjust(left=0.03, right=0.86, bottom=0.03, top=0.9)
        axis = figure.subplots()
        rows = range(len(shown))
        axis.barh(rows, [p for _, p in shown], 0.36, color=AFTER)
        for row, (text, p) in enumerate(shown):
            axis.text(0.0, row - 0.3, text, va='bottom', fontsize=8.5)
            axis.text(p + 0.01, row, percent_text(p), va='center', fontsize=8.5)
        axis.set_xlim(0.0, 1.0)
        axis.set_ylim(len(shown) - 0.6, -0.8)
        axis.axis('off')

    text = '; '.join(f'{name} {percent_text(p)}' for name, p in shown)
    return picture(draw, 'probability of each set of causes', text,
                   (4.8, 0.7 + 0.5 * len(shown)))


def parts_picture(parts: Sequence[PartEstimate]) -> Picture:
    """Return the parts that deviate most: prior and posterior, in tolerances."""
    shown = sorted(parts, key=lambda part: -abs(part.mean) / part.prior)[:PARTS]

    def draw(figure: Any) -> None:
        figure.subplots_adjust(left=0.46, right=0.96, bottom=0.16, top=0.92)
        axis, rows = figure.subplots(), range(len(shown))
        axis.axvspan(-Z95, Z95, color=PRIOR, alpha=0.35, linewidth=0)
        axis.axvspan(-1.0, 1.0, color=PRIOR, alpha=0.6, linewidth=0)
        axis.errorbar([p.mean / p.prior for p in shown], rows,
                      xerr=[Z95 * p.deviation / p.prior for p in shown], color=AFTER, fmt='o',
                      markersize=3.5)
        axis.axvline(0.0, color=MEASURED, linewidth=0.5)
        axis.set_yticks(rows, [label_text(p.name) for p in shown], fontsize=8.0)
        axis.set_ylim(len(shown) - 0.5, -0.5)
        axis.set_xlabel('deviation from the robot file, tolerances')

    text = '; '.join(part_text(part) for part in moved(parts)) or 'none moved by a tolerance'
    return picture(draw, 'parts', text, (4.8, 1.0 + 0.24 * len(shown)))


def moved(parts: Sequence[PartEstimate]) -> list[PartEstimate]:
    """Return the parts that deviate by more than their tolerance, largest deviation first."""
    far = [part for part in parts if abs(part.mean) > MOVED * part.prior]
    return sorted(far, key=lambda part: -abs(part.mean) / part.prior)
