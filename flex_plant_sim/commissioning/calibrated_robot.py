"""The calibrated robot with the tolerances that its logs support, and a table of the results."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.commissioning.calibration import Calibration
from flex_plant_sim.commissioning.items import Item

# Tolerance in the robot file of a part with another name.
TOLERANCE_OF = {'position': 'gauge_position_m', 'payload_inertia': 'payload_inertia_kg_m2',
                'angle_offset': 'angle_zero_rad'}
# Significant digits of a standard deviation (GUM, 7.2.6).
DIGITS = 2


def calibrated_robot(robot: Robot, found: Calibration) -> Robot:
    """
    Return the calibrated robot with its tolerances reduced to the remaining uncertainty.

    A tolerance that several parts share is that of the least certain part.
    """
    left: dict[str, float] = {}
    for item in found.items:
        name = tolerance_name(item)
        left[name] = max(left.get(name, 0.0), item.std)
    shrunk = {name: min(float(f'{std:.{DIGITS}g}'), getattr(robot.tolerances, name))
              for name, std in left.items()}
    return replace(found.robot, tolerances=replace(robot.tolerances, **shrunk))


def tolerance_name(item: Item) -> str:
    """Return the name of the tolerance that gives an item's prior."""
    name = item.name.split(':')[0]
    kind = name if name in TOLERANCE_OF else name.split('_strain_')[0].removesuffix('_1')
    kind = kind.removesuffix('_2')
    return TOLERANCE_OF.get(kind, kind)


def calibration_text(found: Calibration) -> str:
    """Return the results as text, one row for each part."""
    lines = [f'{"part":<24}{"tolerance":>14}{"found":>28}']
    for item in found.items:
        told = item.size(item.tolerance)
        lines.append(f'  {item.name:<22}{"± " + told:>14}'
                     f'{item.size(item.deviation, "+"):>15} ± {item.size(item.std)}')
    return '\n'.join(lines)
