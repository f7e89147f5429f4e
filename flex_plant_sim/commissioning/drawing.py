"""Draws the arm to scale: links, hubs, gauges and the first mode shapes (`flex_robot show`)."""

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
# Number of mode shapes below the arm; write_drawing gives the heights of their rows.
SHAPES = 3
# Deflection of the tip in a mode shape, as a share of the arm's reach.
SHAPE_AMPLITUDE = 0.12
# Factor by which the thickness of links is exaggerated, since they are thin.
THICKNESS_SCALE = 4.0


def write_drawing(path: str | Path, robot: Robot, modes: int) -> None:
    """
    Draw an arm.

    Parameters
    ----------
    path : str or Path
        File name with the suffix of an image.
    robot : Robot
        The arm.
    modes : int
        Modes per link.

    Raises
    ------
    InputError
        Nothing can be written there.

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


def _joint_positions(robot: Robot) -> tuple[float, float]:
    """Return the positions of the two joint axes along the straight arm, m."""
    upper = robot.links[0]
    return 0.0, upper.hub_radius + upper.length


def _draw_arm(axis: Any, robot: Robot) -> None:
    from matplotlib.patches import Circle, Rectangle
    reach = _joint_positions(robot)[1] + robot.links[1].hub_radius + robot.links[1].length
    size = 0.022 * reach
    for j, (link, root) in enumerate(zip(robot.links, _joint_positions(robot))):
        clamp, half = root + link.hub_radius, 0.5 * THICKNESS_SCALE * link.thickness
        if link.hub_radius:
            axis.add_patch(Rectangle((root, -size / 2), link.hub_radius, size, color='0.6'))
        axis.add_patch(Rectangle((clamp, -half), link.length, 2.0 * half, color=COLOURS[j]))
        axis.add_patch(Circle((root, 0.0), size, facecolor='white', edgecolor='black', zorder=3))
        axis.text(clamp + link.length / 2, 2.2 * size, _link_words(j, robot), ha='center',
                  fontsize='small', color=COLOURS[j])
    _draw_gauges(axis, robot, size)
    held = reach + robot.payload_offset
    axis.plot([reach, held], [0.0, 0.0], color='0.6')
    axis.add_patch(Circle((held, 0.0), 0.8 * size, color='tab:red', zorder=3))
    axis.text(held, -2.5 * size, f'payload\n{robot.payload_mass:g} kg', ha='center', va='top',
              fontsize='small', color='tab:red')
    for root, name, below in zip(_joint_positions(robot), ('shoulder', 'elbow'),
                                 ('', f'\n{robot.elbow_mass:g} kg')):
        axis.text(root, -2.5 * size, name + below, ha='center', va='top', fontsize='small')
    axis.set_xlim(-0.06 * reach, 1.08 * max(reach, held))
    axis.set_ylim(-6.5 * size, 6.5 * size)
    axis.set_aspect('equal')
    axis.set_ylabel('m')


def _link_words(j: int, robot: Robot) -> str:
    link = robot.links[j]
    return (f'{("upper", "lower")[j]}: {1e3 * link.length:g} x {1e3 * link.thickness:g} x '
            f'{1e3 * link.height:g} mm, {1e3 * link.mass:.0f} g')


def _draw_gauges(axis: Any, robot: Robot, size: float) -> None:
    names = iter(robot.gauge_names)
    for link, root in zip(robot.links, _joint_positions(robot)):
        for position in link.gauge_positions:
            x = root + link.hub_radius + position
            axis.plot([x, x], [-size, size], color='tab:orange', linewidth=3, zorder=4)
            axis.text(x, 1.1 * size, next(names), ha='left', va='bottom', fontsize='small',
                      color='tab:orange', rotation=30)


def _draw_mode(axis: Any, robot: Robot, modes: int, flexible: Array) -> None:
    lines = _shape_function(robot, modes)(flexible)
    reach, largest = lines[1, -1, 0], np.abs(lines[..., 1]).max()
    for line, colour in zip(lines, COLOURS):
        axis.plot(line[:, 0], SHAPE_AMPLITUDE * reach * line[:, 1] / largest, color=colour)
    axis.axhline(0.0, color='0.8', linewidth=0.8, zorder=0)
    axis.plot(*_end(lines, reach, largest), 'o', color='tab:red', markersize=5)
    axis.set_ylim(-1.4 * SHAPE_AMPLITUDE * reach, 1.4 * SHAPE_AMPLITUDE * reach)
    axis.set_yticks([])


def _end(lines: Array, reach: float, largest: float) -> tuple[float, float]:
    return reach, SHAPE_AMPLITUDE * reach * float(lines[1, -1, 1]) / largest


def _shape_function(robot: Robot, modes: int) -> Callable[[Array], Array]:
    """Return a function from small flexible coordinates (2 modes,) to centre lines (2, P, 2)."""
    shape = ArmShape.of(ExtendedArm(robot, 'assumed_modes', modes))
    lower_root = _joint_positions(robot)[1]

    def lines(flexible: Array) -> Array:
        q = np.concatenate([np.zeros(2), flexible])
        upper = shape.deflection[0] @ q[link_slice(0, modes)]
        slope = shape.tip_slope @ q[link_slice(0, modes)]
        lower = upper[-1] + shape.along[1] * slope \
            + shape.deflection[1] @ q[link_slice(1, modes)]
        return np.array([np.stack([shape.along[0], upper], axis=1),
                         np.stack([lower_root + shape.along[1], lower], axis=1)])

    return lines
