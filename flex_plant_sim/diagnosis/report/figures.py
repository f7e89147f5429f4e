"""The figures of the report: one small SVG for each channel, sized for a phone, as data URIs."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from io import BytesIO
from typing import Any

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.arm.units import CHANNEL_SHOWN
from flex_plant_sim.diagnosis.pool import all_of
from flex_plant_sim.diagnosis.prediction.free_run import (
    free_run,
    horizon_samples,
    window_rows,
)
from flex_plant_sim.diagnosis.prediction.latent_view import binned
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.diagnosis.verdict.improvement import Gain
from flex_plant_sim.diagnosis.verdict.symptoms import drift, DRIFTED, one_step, spectrum
from flex_plant_sim.diagnosis.verdict.wording import digits_text
from flex_plant_sim.tiny import TINY
import numpy as np

MEASURED, BEFORE, AFTER = '#333333', '#d95f02', '#1b6ca8'
# Size of a figure, inches: three fit side by side on a desktop screen.
SIZE = (4.4, 2.7)
# Number of points of a trace, more than a figure has pixels in width on a phone.
POINTS = 400
# Length of the traces, s: ten periods of the reference arm, which can still be told apart.
SHOWN_SECONDS = 8.0
# Range of an axis, as a ratio, below which thirds of decades are marked too: an axis of less than
# two decades may contain no decade mark.
THIRDS_BELOW = 100.0
# Error, in ranges of the measurement, beyond which a model's trace would hide the others; and what
# an axis leaves beyond its traces, as a share of their range.
DIVERGED, MARGIN = 1.5, 0.05


@dataclass(frozen=True)
class Picture:
    """An image for <img src>, with its title and a text alternative."""

    source: str
    text: str


def _channels(predictor: Predictor) -> Iterator[tuple[str, str]]:
    """Yield name and SI unit of each measured channel."""
    robot = predictor.base.robot
    yield from zip(robot.output_names, robot.output_units)


def gain_pictures(gains: Sequence[Gain]) -> list[Picture]:
    """Return the errors before and after over the horizon, one picture for each channel."""
    pictures = []
    for channel in dict.fromkeys(gain.channel for gain in gains):
        rows = [gain for gain in gains if gain.channel == channel and np.isfinite(gain.before)]
        scale, unit = CHANNEL_SHOWN[rows[0].unit]

        def draw(figure: Any, rows: list[Gain] = rows, scale: float = scale,
                 unit: str = unit) -> None:
            axis, at = figure.subplots(), [gain.horizon for gain in rows]
            axis.plot(at, [scale * g.before for g in rows], 'o-', color=BEFORE, label='before')
            axis.plot(at, [scale * g.after for g in rows], 's-', color=AFTER, label='after')
            axis.fill_between(at, [scale * g.low for g in rows], [scale * g.high for g in rows],
                              color=AFTER, alpha=0.2, linewidth=0)
            _logarithmic(axis)
            axis.set_xticks(at, [f'{h:g}' for h in at])
            axis.set_xlabel('simulated ahead, s')
            axis.set_ylabel(f'rms error, {unit}')
            axis.legend(frameon=False)

        worst = rows[-1]
        pictures.append(picture(draw, channel, (
            f'{channel}: root mean square error over the horizon; at {worst.horizon:g} s '
            f'{digits_text(scale * worst.before, 3)} {unit} before, '
            f'{digits_text(scale * worst.after, 3)} after')))
    return pictures


def trace_pictures(nominal: Predictor, extended: Predictor) -> list[Picture]:
    """Return the measurement, both models' free runs on the locked part, and their errors."""
    step, (first, stop) = nominal.base.robot.sample_time, window_rows(nominal)
    steps = min(stop - first, horizon_samples(SHOWN_SECONDS, step))
    rows = first + np.arange(steps)
    before, after = (free_run(p, np.array([first]), steps)[:, 0] for p in (nominal, extended))
    kept = slice(None, None, max(1, steps // POINTS))
    pictures = []
    for k, (name, si_unit) in enumerate(_channels(nominal)):
        scale, unit = CHANNEL_SHOWN[si_unit]
        lines = [scale * values[kept, k] for values in
                 (nominal.record.output[rows], before, after)]

        def draw(figure: Any, lines: list[Array] = lines, unit: str = unit) -> None:
            draw_traces(figure, nominal.record.time[rows][kept], lines, unit)

        pictures.append(picture(draw, name, (
            f'{name}: measured and simulated over {steps * step:.3g} s of the locked part, '
            'before and after, and the difference from the measurement'), (SIZE[0], 3.6)))
    return pictures


def draw_traces(figure: Any, time: Array, lines: Sequence[Array], unit: str) -> None:
    """Draw what was measured and both models' free runs over time, (N,) each, and the errors."""
    measured, before, after = lines
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    upper.plot(time, before, color=BEFORE, label='before')
    upper.plot(time, after, color=AFTER, label='after')
    upper.plot(time, measured, color=MEASURED, linewidth=0.8, linestyle=(0, (3, 1)),
               label='measured')
    reach = DIVERGED * float(np.ptp(measured)) + TINY
    near = [line for line in (before, after) if np.max(np.abs(line - measured)) < reach]
    _show(upper, [measured, *near])
    upper.set_ylabel(unit)
    upper.legend(frameon=False, ncols=3, loc='lower center', bbox_to_anchor=(0.5, 0.97),
                 handlelength=1.2, columnspacing=1.0)
    lower.plot(time, measured - before, color=BEFORE)
    lower.plot(time, measured - after, color=AFTER)
    _show(lower, [measured - line for line in near] or [measured - measured.mean()])
    lower.axhline(0.0, color=MEASURED, linewidth=0.5)
    lower.set_ylabel(f'error, {unit}')
    lower.set_xlabel('time, s')


def _show(axis: Any, lines: Sequence[Array]) -> None:
    """Let an axis show these lines whole: a model that diverges would hide all others."""
    low, high = min(map(np.min, lines)), max(map(np.max, lines))
    margin = MARGIN * (high - low) or 1.0
    axis.set_ylim(low - margin, high + margin)


def speed_pictures(nominal: Sequence[Predictor], extended: Sequence[Predictor]) -> list[Picture]:
    """Return the mean error after a short free run over the speed of the nearest joint."""
    both = [_speeds_and_errors(predictors) for predictors in (nominal, extended)]
    pictures = []
    for k, (name, si_unit) in enumerate(_channels(nominal[0])):
        joint = int(name.split('_')[1][0]) - 1
        scale, unit = CHANNEL_SHOWN[si_unit]
        curves = [binned(speed[:, joint], scale * error[:, k]) for speed, error in both]

        def draw(figure: Any, curves: list[Array] = curves, joint: int = joint,
                 unit: str = unit) -> None:
            axis = figure.subplots()
            for (speed, mean, spread), colour, label in zip(
                    curves, (BEFORE, AFTER), ('before', 'after')):
                axis.errorbar(speed, mean, spread, color=colour, label=label, marker='.',
                              elinewidth=0.6)
            axis.axhline(0.0, color=MEASURED, linewidth=0.5)
            axis.locator_params(axis='x', nbins=6)
            axis.set_xlabel(f'speed of joint {joint + 1}, rad/s')
            axis.set_ylabel(f'error after {DRIFTED:g} s, {unit}')
            axis.legend(frameon=False)

        pictures.append(picture(draw, name, (
            f'{name}: mean error after {DRIFTED:g} s of free run over the speed of joint '
            f'{joint + 1}, before and after')))
    return pictures


def _speeds_and_errors(predictors: Sequence[Predictor]) -> tuple[Array, Array]:
    found = []
    for p in predictors:
        rows, error = drift(p)
        order = p.arm.form.order
        found.append((p.states[rows, order:order + 2], error))
    return np.vstack([f[0] for f in found]), np.vstack([f[1] for f in found])


def spectrum_pictures(nominal: Sequence[Predictor],
                      extended: Sequence[Predictor]) -> list[Picture]:
    """Return the power spectral density of the one-step errors before and after, and of noise."""
    step = nominal[0].base.robot.sample_time
    both = [spectrum([one_step(p) for p in predictors], step)
            for predictors in (nominal, extended)]
    pictures = []
    for k, (name, si_unit) in enumerate(_channels(nominal[0])):
        scale, unit = CHANNEL_SHOWN[si_unit]
        white = scale**2 * nominal[0].noise[k]**2 * 2.0 * step

        def draw(figure: Any, k: int = k, white: float = white, scale: float = scale,
                 unit: str = unit) -> None:
            axis = figure.subplots()
            for (frequency, power), colour, label in zip(
                    both, (BEFORE, AFTER), ('before', 'after')):
                axis.plot(frequency[1:], scale**2 * power[1:, k], color=colour, label=label)
            _logarithmic(axis)
            axis.axhline(white, color=MEASURED, linewidth=0.8, linestyle='--',
                         label='sensor noise')
            axis.set_xlabel('frequency, Hz')
            axis.set_ylabel(f'({unit})²/Hz')
            axis.legend(frameon=False)

        pictures.append(picture(draw, name, (
            f'{name}: power density of the one-step error before and after, beside that of '
            'the sensor noise')))
    return pictures


def _logarithmic(axis: Any) -> None:
    """
    Make axes logarithmic, with plain numbers at decades, or thirds of decades on a short axis.

    Matplotlib's own tick labels are formulas, which take half of the drawing time. An axis along
    which nothing is positive, as the error of a channel that is constant, stays linear.
    """
    from matplotlib.ticker import LogLocator
    for scale, least, set_scale in ((axis.xaxis, axis.dataLim.minposx, axis.set_xscale),
                                    (axis.yaxis, axis.dataLim.minposy, axis.set_yscale)):
        if not np.isfinite(least):
            continue
        set_scale('log')
        axis.minorticks_off()
        low, high = scale.get_view_interval()
        if high < THIRDS_BELOW * low:
            scale.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        scale.set_major_formatter('{x:g}')


def picture(draw: Callable[[Any], None], title: str, text: str,
            size: tuple[float, float] = SIZE) -> Picture:
    """Return the picture that `draw` makes on a figure."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure
    style: Any = {
        'font.size': 9.0, 'axes.titlesize': 10.0, 'axes.titleweight': 'bold',
        'axes.spines.top': False, 'axes.spines.right': False, 'axes.grid': True,
        'grid.alpha': 0.25, 'lines.linewidth': 1.3, 'svg.hashsalt': 'flex_diagnose',
        'axes.formatter.limits': (-3, 4), 'axes.xmargin': 0.02}
    with rc_context(style):
        figure = Figure(figsize=size)
        figure.subplots_adjust(left=0.17, right=0.97, bottom=0.17, top=0.86, hspace=0.12)
        FigureCanvasSVG(figure)
        draw(figure)
        figure.suptitle(title.replace('_', ' '), x=0.02, ha='left', fontsize=10.0,
                        fontweight='bold')
        stream = BytesIO()
        figure.savefig(stream, format='svg', metadata={'Date': None, 'Creator': None})
    encoded = base64.b64encode(stream.getvalue()).decode('ascii')
    return Picture(f'data:image/svg+xml;base64,{encoded}', text)


def all_pictures(gains: Sequence[Gain], nominal: Sequence[Predictor],
                 extended: Sequence[Predictor], jobs: int) -> dict[str, list[Picture]]:
    """Return all pictures of the report by section; traces are those of the first record."""
    sections: dict[str, Callable[[], list[Picture]]] = {
        'gains': partial(gain_pictures, gains),
        'traces': partial(trace_pictures, nominal[0], extended[0]),
        'speed': partial(speed_pictures, nominal, extended),
        'spectrum': partial(spectrum_pictures, nominal, extended)}
    # Workers inherit it, instead of each importing it.
    import matplotlib.backends.backend_svg  # noqa: F401
    return dict(zip(sections, all_of(lambda draw: draw(), [*sections.values()], jobs)))
