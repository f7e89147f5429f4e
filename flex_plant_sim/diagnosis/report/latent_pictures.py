"""The report's first pictures: latent torques and gauge errors over variables of the motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.pool import all_of
from flex_plant_sim.diagnosis.prediction.latent_view import Finding, LatentView
from flex_plant_sim.diagnosis.prediction.law import CONSTANT, CrossValidation
from flex_plant_sim.diagnosis.report.figures import AFTER, BEFORE, MEASURED, Picture, picture
from flex_plant_sim.diagnosis.verdict.unknown import likely_text
from flex_plant_sim.diagnosis.verdict.wording import digits_text, percent_text, shown_unit
from flex_plant_sim.interval import Z95
import numpy as np

# Largest numbers of dots, points of a line and points of a trace in a picture: as many as can be
# distinguished, so that the file stays small.
DOTS, LINE_POINTS, TRACE_POINTS = 1500, 400, 1200


@dataclass(frozen=True)
class LatentSection:
    """A joint or gauge: the text about it, and its pictures, the best variable first."""

    title: str
    text: str
    pictures: tuple[Picture, ...]


def latent_sections(view: LatentView, jobs: int) -> tuple[LatentSection, ...]:
    """Return sections for joints that move, and for gauges with errors beyond a good model's."""
    shown = (*view.torques, *(f for f in view.gauges if f.exceeds_model_error))
    return tuple(all_of(_section, shown, jobs))


def _section(finding: Finding) -> LatentSection:
    series, best = finding.series, finding.validations[0]
    scale, unit = shown_unit(series.unit)
    what = 'torque' if series.unit == 'N m' else 'error'
    band = Z95 * float(np.median(series.deviation[series.scored]))
    text = (f'{digits_text(scale * series.rms, 2)} {unit} rms, '
            f'95 % band ± {digits_text(scale * band, 2)} {unit}. '
            + _finding_text(finding))
    order: list[str] = [t.variable for t in finding.validations if t.variable in series.variables]
    wanted = order if what == 'torque' else [best.variable, 'time']
    names = [n for n in dict.fromkeys(wanted) if n in series.variables]
    validations = {t.variable: t for t in finding.validations}
    return LatentSection(f'{series.site.replace("_", " ")}: unseen {what}', text, tuple(
        _picture(finding, validations[name]) for name in names))


def _finding_text(finding: Finding) -> str:
    law, line = finding.law, finding.line
    if not finding.exceeds_model_error:
        return 'No more than two good models of an arm differ by.'
    if law.stated and law.variable == CONSTANT:
        return 'It is constant.'
    if law.stated:
        return (f'Its {_variable_text(law.variable)} explains {percent_text(law.share)} of it '
                'where not fitted.')
    if finding.has_memory:
        swings = f' It swings at {digits_text(line.frequency, 2)} Hz.' if line else ''
        return ('None of these explains half of it: behind it are several, an acceleration (as of '
                f'a wrong mass), or something with a memory.{swings}')
    return f'It seems to follow {likely_text(finding)}.'


def _variable_text(variable: str) -> str:
    return variable.replace('_', ' ')


def _picture(finding: Finding, trial: CrossValidation) -> Picture:
    series, variable = finding.series, trial.variable
    scale, unit = shown_unit(series.unit)
    factor, at_unit = shown_unit(series.variables[variable][0])
    x, rows = factor * series.variables[variable][1], np.flatnonzero(series.scored)
    explained = percent_text(max(trial.share, 0.0)) if finding.exceeds_model_error else ''

    def draw(figure: Any) -> None:
        axis = figure.subplots()
        axis.axhline(0.0, color=MEASURED, linewidth=0.5)
        if variable == 'time':
            _draw_trace(axis, x, scale * series.value, scale * series.deviation)
        else:
            _draw_cloud(axis, x[rows], scale * series.value[rows])
            _draw_means(axis, [f * c for f, c in zip((factor, scale, scale),
                                                     finding.curve(variable))])
        law = finding.law
        if law.stated and law.variable == variable:
            _draw_law(axis, factor, scale, finding)
        axis.locator_params(axis='x', nbins=6)
        axis.set_xlabel(', '.join(t for t in (_variable_text(variable), at_unit) if t))
        axis.set_ylabel(unit)
        if explained:
            figure.text(0.97, 0.95, f'explains {explained}', ha='right', va='top', fontsize=9.0,
                        color=AFTER if law.stated and law.variable == variable else MEASURED)

    title = f'{series.site} over {_variable_text(variable)}'
    return picture(draw, title, f'{title}: smoothed latent force with its mean and spread; '
                   f'explains {explained or "nothing that matters"} where not fitted')


def _draw_cloud(axis: Any, x: Array, value: Array) -> None:
    kept = slice(None, None, max(1, len(x) // DOTS))
    axis.plot(x[kept], value[kept], '.', color=MEASURED, alpha=0.45, markersize=2.5,
              markeredgewidth=0.0, rasterized=True)


def _draw_means(axis: Any, curve: Sequence[Array]) -> None:
    at, mean, spread = curve
    axis.errorbar(at, mean, spread, color=BEFORE, marker='.', linestyle='none', elinewidth=0.7)


def _draw_trace(axis: Any, time: Array, value: Array, deviation: Array) -> None:
    kept = slice(None, None, max(1, len(time) // TRACE_POINTS))
    # The records are concatenated, and the time of each starts again.
    starts = np.flatnonzero(np.diff(time[kept]) < 0.0) + 1
    for t, v, d in zip(*(np.split(part[kept], starts) for part in (time, value, deviation))):
        axis.fill_between(t, v - Z95 * d, v + Z95 * d, color=BEFORE, alpha=0.35, linewidth=0)
        axis.plot(t, v, color=BEFORE, linewidth=0.6)


def _draw_law(axis: Any, factor: float, scale: float, finding: Finding) -> None:
    law = finding.law
    at = np.unique(np.concatenate([np.linspace(law.knots[0], law.knots[-1], LINE_POINTS),
                                   law.knots]))
    axis.plot(factor * at, scale * law.at(at), color=AFTER, linewidth=1.8)
    axis.errorbar(factor * law.knots, scale * law.values, Z95 * scale * law.deviations,
                  color=AFTER, linestyle='none', elinewidth=1.2)
