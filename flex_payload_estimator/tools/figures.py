"""
flex_figures: the paper's Figures 13, 14, 15 and 18, and the accuracy of the delta form.

They show the beam and the delta model; figures of a closed loop are in `control/loop_figures.py`.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
import sys

from flex_payload_estimator.colours import BLUE, GREEN, ORANGE, VIOLET
from flex_payload_estimator.model.delta import digits_over_step
from flex_plant_sim.arm.beam import Beam, frequency_roots
from flex_plant_sim.arm.paper_model import CompactModel
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.atomic_file import made_folder, MARK, whole_file
from flex_plant_sim.tools import command_line
from flex_plant_sim.tools.outputs import check_folder, results
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np

# Size of a figure, inches, and its resolution, dots per inch.
SIZE, RESOLUTION = (8.0, 5.6), 120
# Number of mode shapes, and of beam constants, that are drawn.
MODES, CONSTANTS = 4, 10
COLOURS = (BLUE, ORANGE, GREEN, VIOLET)
STYLES = ('-', '--', '-.', ':')
# Labels of the shape and its derivatives of order 1 to 3.
QUANTITIES = (r'$\varphi_i(x)$', r"$L\,\varphi_i'(x)$", r"$L^2\varphi_i''(x)$",
              r"$L^3\varphi_i'''(x)$")


def figure_13(figure: Figure) -> None:
    """Draw the normal functions and their first derivative."""
    _shapes(figure, (0, 1), 'Figure 13: normal functions and their first derivative')


def figure_14(figure: Figure) -> None:
    """Draw the second and third derivative: proportional to torque and shear force."""
    _shapes(figure, (2, 3), 'Figure 14: second and third derivative, as torque and shear force')


def figure_15(figure: Figure) -> None:
    """Draw alpha_i / L and beta_i over the mode number."""
    beam = Beam.with_modes(1.0, 1.0, 1.0, CONSTANTS)
    numbers = np.arange(1, CONSTANTS + 1)
    axes = figure.subplots()
    for offset, values, colour, label in ((-0.12, beam.alpha, COLOURS[0], r'$\alpha_i/L$'),
                                          (0.12, beam.beta, COLOURS[1], r'$\beta_i$')):
        axes.vlines(numbers + offset, 0.0, values, color=colour, linewidth=2.0)
        axes.plot(numbers + offset, values, 'o', color=colour, label=label)
    axes.axhline(0.0, color='black', linewidth=0.8)
    axes.set_xticks(numbers)
    _finish(axes, 'mode i', 'beam constant', r'Figure 15: $\alpha_i/L$ and $\beta_i$')


def figure_18(figure: Figure) -> None:
    """Draw the two terms of the frequency equation, which cross at gamma_i L."""
    x, roots = np.linspace(0.0, 12.0, 600), frequency_roots(4)
    axes = figure.subplots()
    axes.plot(x, np.cos(x), color=COLOURS[0], label=r'$\cos x$')
    axes.plot(x, -1.0 / np.cosh(x), STYLES[1], color=COLOURS[1], label=r'$-1/\cosh x$')
    axes.plot(roots, np.cos(roots), 'o', color='black', label=r'roots $\gamma_i L$')
    for root in roots:
        axes.annotate(f'{root:.4f}', (root, np.cos(root)), (0, 12), textcoords='offset points',
                      ha='center', bbox={'facecolor': 'white', 'alpha': 0.8, 'linewidth': 0.0})
    _finish(axes, 'x', '', 'Figure 18: the two terms of the frequency equation')


def figure_delta(figure: Figure) -> None:
    """Draw the relative error of A-bar in delta and in shift form over the sampling time."""
    robot = load_robot('reference')
    a, _ = CompactModel(robot, 2).at(0.5).state_space(robot.payload_mass)
    steps = np.logspace(-8, -1, 29)
    delta, shift = digits_over_step(a, steps, float(np.max(np.abs(np.linalg.eigvals(a)))))
    axes = figure.subplots()
    floor = 1e-18
    axes.loglog(steps, np.maximum(shift, floor), 'o-', color=COLOURS[1],
                label='shift form, (F − I)/T of the rounded F')
    axes.loglog(steps, np.maximum(delta, floor), 's-', color=COLOURS[0],
                label=r'delta form, $\bar A = \Omega A$')
    axes.axvline(robot.sample_time, color='gray', linestyle=':', label='T of the paper')
    _finish(axes, 'sampling time T, s', r'relative error of $\bar A$',
            'Digits left in the sampled model (n = 2)')


FIGURES: dict[str, Callable[[Figure], None]] = {
    'figure_13': figure_13, 'figure_14': figure_14, 'figure_15': figure_15,
    'figure_18': figure_18, 'delta_against_shift': figure_delta}


def _shapes(figure: Figure, derivatives: tuple[int, int], title: str) -> None:
    """Draw two derivatives of the mode shapes, given by their order, in two panels."""
    beam, x = Beam.with_modes(1.0, 1.0, 1.0, MODES), np.linspace(0.0, 1.0, 301)
    for axes, derivative in zip(figure.subplots(2, 1, sharex=True), derivatives):
        values = beam.shape(x, derivative)
        for i in range(MODES):
            axes.plot(x, values[:, i], STYLES[i], color=COLOURS[i], label=f'i = {i + 1}')
        last = derivative == derivatives[1]
        _finish(axes, 'x / L' if last else '', QUANTITIES[derivative], '' if last else title)


def _finish(axes: Axes, x: str, y: str, title: str) -> None:
    """Add labels, title, grid and legend."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_title(title)
    axes.grid(alpha=0.3)
    axes.legend(fontsize='small')


def write_figure(name: str, folder: Path) -> Path:
    """
    Draw one of FIGURES as PNG into an existing folder, whole or not at all; return its path.

    Raises
    ------
    InputError
        Nothing can be written there.

    """
    figure = Figure(figsize=SIZE, layout='constrained')
    FigureCanvasAgg(figure)
    FIGURES[name](figure)
    path = folder / f'{name}.png'
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=RESOLUTION, metadata={'Software': MARK})
    return path


def options() -> argparse.ArgumentParser:
    """Return the options of flex_figures."""
    parser = command_line.parser("Draw the paper's Figures 13, 14, 15, 18, and one of the delta "
                                 "form's digits, as PNG.")
    parser.add_argument('--out', default='figures', metavar='DIR', help='folder for the figures')
    return parser


def _main(arguments: argparse.Namespace) -> None:
    folder = Path(arguments.out)
    check_folder('--out', folder, [f'{name}.png' for name in FIGURES], nested=True)
    with made_folder(folder), results() as write:
        for name in FIGURES:
            write(_write, name, folder)


def _write(name: str, folder: Path) -> None:
    print(write_figure(name, folder))


def main(argv: Sequence[str] | None = None) -> int:
    """Run flex_figures and return its exit code."""
    return command_line.run(lambda: _main(options().parse_args(argv)))


if __name__ == '__main__':
    sys.exit(main())
