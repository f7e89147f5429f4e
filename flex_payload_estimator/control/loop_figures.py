"""Figures 4 to 9 of the paper, drawn from the record of a closed loop (`loop.LoopRecord`)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from flex_payload_estimator.colours import BLUE, GREY, ORANGE
from flex_payload_estimator.control.loop import LoopRecord
from flex_plant_sim.interval import Z95
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

# Size of a figure, inches, and its resolution, dots per inch.
SIZE, RESOLUTION = (7.5, 4.2), 130
ANGLES = (r'$\theta_{b1}$', r'$\theta_2$')


def figure_4(record: LoopRecord, figure: Figure) -> None:
    """Draw the measured angles and their references."""
    axes = figure.subplots()
    _angles(axes, record, 0, BLUE)
    _angles(axes, record, 1, ORANGE)
    _finish(axes, 'angle / rad', 'Figure 4: measured angles and their references')


def figure_5(record: LoopRecord, figure: Figure) -> None:
    """Draw the estimated payload with its 95 % interval, and the true payload."""
    axes = figure.subplots()
    half = Z95 * np.sqrt(record.variance)
    axes.fill_between(record.time, record.mass - half, record.mass + half, color=BLUE, alpha=0.2,
                      lw=0, label='95 % interval')
    axes.plot(record.time, record.mass, color=BLUE, label=r'estimate $\hat m_p$')
    axes.plot(record.time, record.true_mass, '--', color=GREY, label='true payload')
    top = max(float(record.mass.max()), float(record.true_mass.max()), 1e-3)
    axes.set_ylim(-0.1 * top, 1.3 * top)
    _finish(axes, 'payload / kg', 'Figure 5: estimated payload')


def figure_6(record: LoopRecord, figure: Figure) -> None:
    """Draw the variance of the estimate, and P_t of SF1, which is not a variance."""
    axes = figure.subplots()
    axes.semilogy(record.time, record.variance, color=BLUE, label='variance / kg²')
    axes.semilogy(record.time, record.p, color=ORANGE, label=r'$P_t$')
    _finish(axes, 'variance / kg²', r'Figure 6: variance of the estimate, and $P_t$ beside it')


def figure_7(record: LoopRecord, figure: Figure) -> None:
    """Draw angular positions and references, one panel per joint."""
    for joint, axes in enumerate(figure.subplots(2, 1, sharex=True)):
        _angles(axes, record, joint, BLUE)
        _finish(axes, 'angle / rad', 'Figure 7: angular positions' if joint == 0 else '',
                last=joint == 1)


def figure_8(record: LoopRecord, figure: Figure) -> None:
    """Draw q_i1 and 10 q_i2 of each link i, mm."""
    modes = record.modal.shape[1] // 2
    for link, axes in enumerate(figure.subplots(2, 1, sharex=True)):
        for k, (scale, colour) in enumerate(((1.0, BLUE), (10.0, ORANGE))[:modes]):
            axes.plot(record.time, 1e3 * scale * record.modal[:, link * modes + k], color=colour,
                      lw=1.0, label=f'{"10 " if k else ""}$q_{{{link + 1}{k + 1}}}$')
        _finish(axes, 'q / mm', 'Figure 8: harmonic time functions' if link == 0 else '',
                last=link == 1)


def figure_9(record: LoopRecord, figure: Figure) -> None:
    """Draw the control inputs, in the drive's own unit."""
    axes = figure.subplots()
    for joint, colour in enumerate((BLUE, ORANGE)):
        axes.step(record.time, record.command[:, joint], where='post', color=colour, lw=1.0,
                  label=f'$u_{joint + 1}$')
    _finish(axes, "command / drive's own unit", 'Figure 9: control inputs')


# The functions by the number of the figure in the paper.
FIGURES: dict[int, Callable[[LoopRecord, Figure], None]] = {
    4: figure_4, 5: figure_5, 6: figure_6, 7: figure_7, 8: figure_8, 9: figure_9}


def save_figures(record: LoopRecord, folder: Path, numbers: tuple[int, ...]) -> list[Path]:
    """Write figure_N.png for each number; return the paths."""
    paths = []
    for number in numbers:
        figure = Figure(figsize=SIZE, layout='constrained')
        FIGURES[number](record, figure)
        paths.append(folder / f'figure_{number}.png')
        figure.savefig(paths[-1], dpi=RESOLUTION)
    return paths


def _angles(axes: Axes, record: LoopRecord, joint: int, colour: str) -> None:
    """Draw the measured angle and the set-point of a joint."""
    axes.plot(record.time, record.output[:, joint], color=colour, label=ANGLES[joint])
    axes.step(record.time, record.set_point[:, joint], '--', where='post', color=colour, lw=1.0,
              alpha=0.7, label=f'$w_{joint + 1}$')


def _finish(axes: Axes, label: str, title: str, last: bool = True) -> None:
    """Label axes and add the legend; only the last panel of a figure labels its time axis."""
    axes.set_ylabel(label)
    if last:
        axes.set_xlabel('time / s')
    if title:
        axes.set_title(title, loc='left', fontsize=10)
    axes.margins(x=0.0)
    axes.grid(alpha=0.3)
    axes.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1, frameon=False,
                fontsize=9, ncols=4)
