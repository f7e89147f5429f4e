"""A drawing of the arm: links, hubs, gauges and the first mode shapes, to scale."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array, link_slice
from flex_plant_sim.atomic_file import image_metadata, whole_file
from flex_plant_sim.commissioning.summary import locked_modes
from flex_plant_sim.simulation.arm_shape import ArmShape
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

COLOURS = ('tab:blue', 'tab:green')
# Below the arm; the heights of their rows stand beside that of the arm.
SHAPES = 3
# The tip of a mode shape moves this share of the arm's reach.
SWING = 0.12
# Links are thin: they are drawn this much thicker than they are.
THICKER = 4.0


def write_drawing(path: str | Path, robot: Robot, modes: int) -> None:
    """
    Draw an arm.

    Parameters
    ----------
    path : str or Path
        With the suffix of an image.
    robot : Robot
        The arm.
    modes : int
        Modes a link.

    Raises
    ------
    InputError
        If nothing can be written there.

    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    figure = Figure(figsize=(10.0, 7.5), layout='constrained')
    FigureCanvasAgg(figure)
    rows = figure.subplots(1 + SHAPES, 1, sharex=True, height_ratios=(2.2, 1, 1, 1))
    _draw_arm(rows[0], robot)
    frequencies, shapes = locked_modes(robot, modes, robot.payload_mass)
    for k, axis in enumerate(rows[1:]):
        _draw_mode(axis, robot, modes, shapes[:, k])
        axis.set_title(f'mode {k + 1}: {frequencies[k]:.2f} Hz with {robot.payload_mass:g} kg',
                       fontsize='small', loc='left')
    rows[-1].set_xlabel('m')
    figure.suptitle(f'{robot.name}, from above, elbow straight, joints held')
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=110, metadata=image_metadata(path))


def _roots(robot: Robot) -> tuple[float, float]:
    """Return where the two joint axes are along the straight arm, m."""
    upper = robot.links[0]
    return 0.0, upper.hub_radius + upper.length


def _draw_arm(axis: Any, robot: Robot) -> None:
    from matplotlib.patches import Circle, Rectangle
    reach = _roots(robot)[1] + robot.links[1].hub_radius + robot.links[1].length
    size = 0.022 * reach
    for j, (link, root) in enumerate(zip(robot.links, _roots(robot))):
        clamp, half = root + link.hub_radius, 0.5 * THICKER * link.thickness
        if link.hub_radius:
            axis.add_patch(Rectangle((root, -size / 2), link.hub_radius, size, color='0.6'))
        axis.add_patch(Rectangle((clamp, -half), link.length, 2.0 * half, color=COLOURS[j]))
        axis.add_patch(Circle((root, 0.0), size, facecolor='white', edgecolor='black', zorder=3))
        axis.text(clamp + link.length / 2, 2.2 * size, _link_words(j, robot), ha='center',
                  fontsize='small', color=COLOURS[j])
    _draw_gauges(axis, robot, size)
    axis.add_patch(Circle((reach, 0.0), 0.8 * size, color='tab:red', zorder=3))
    axis.text(reach, -2.5 * size, f'payload\n{robot.payload_mass:g} kg', ha='center', va='top',
              fontsize='small', color='tab:red')
    for root, name, below in zip(_roots(robot), ('shoulder', 'elbow'),
                                 ('', f'\n{robot.elbow_mass:g} kg')):
        axis.text(root, -2.5 * size, name + below, ha='center', va='top', fontsize='small')
    axis.set_xlim(-0.06 * reach, 1.08 * reach)
    axis.set_ylim(-6.5 * size, 6.5 * size)
    axis.set_aspect('equal')
    axis.set_ylabel('m')


def _link_words(j: int, robot: Robot) -> str:
    link = robot.links[j]
    return (f'{("upper", "lower")[j]}: {1e3 * link.length:g} x {1e3 * link.thickness:g} x '
            f'{1e3 * link.height:g} mm, {1e3 * link.mass:.0f} g')


def _draw_gauges(axis: Any, robot: Robot, size: float) -> None:
    names = iter(robot.gauge_names)
    for link, root in zip(robot.links, _roots(robot)):
        for position in link.gauge_positions:
            x = root + link.hub_radius + position
            axis.plot([x, x], [-size, size], color='tab:orange', linewidth=3, zorder=4)
            axis.text(x, 1.1 * size, next(names), ha='left', va='bottom', fontsize='small',
                      color='tab:orange', rotation=30)


def _draw_mode(axis: Any, robot: Robot, modes: int, flexible: Array) -> None:
    lines = _bent(robot, modes)(flexible)
    reach, largest = lines[1, -1, 0], np.abs(lines[..., 1]).max()
    for line, colour in zip(lines, COLOURS):
        axis.plot(line[:, 0], SWING * reach * line[:, 1] / largest, color=colour)
    axis.axhline(0.0, color='0.8', linewidth=0.8, zorder=0)
    axis.plot(*_end(lines, reach, largest), 'o', color='tab:red', markersize=5)
    axis.set_ylim(-1.4 * SWING * reach, 1.4 * SWING * reach)
    axis.set_yticks([])


def _end(lines: Array, reach: float, largest: float) -> tuple[float, float]:
    return reach, SWING * reach * float(lines[1, -1, 1]) / largest


def _bent(robot: Robot, modes: int) -> Callable[[Array], Array]:
    """Return what makes centre lines (2, P, 2) of small flexible coordinates (2 modes,)."""
    shape = ArmShape.of(ExtendedArm(robot, 'assumed_modes', modes))
    lower_root = _roots(robot)[1]

    def lines(flexible: Array) -> Array:
        q = np.concatenate([np.zeros(2), flexible])
        upper = shape.deflection[0] @ q[link_slice(0, modes)]
        slope = shape.tip_slope @ q[link_slice(0, modes)]
        lower = upper[-1] + shape.along[1] * slope \
            + shape.deflection[1] @ q[link_slice(1, modes)]
        return np.array([np.stack([shape.along[0], upper], axis=1),
                         np.stack([lower_root + shape.along[1], lower], axis=1)])

    return lines
