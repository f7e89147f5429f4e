"""The calibrated robot with the tolerances that its logs support, and a table of the results."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.commissioning.calibration import Calibration, notable

# Tolerance in the robot file of a part with another name.
TOLERANCE_OF = {'position': 'gauge_position_m', 'angle_offset': 'angle_zero_rad'}
# Tolerances from which a part's deviation is doubted: of 370 parts of healthy arms one has it.
DOUBTED = 3.0
# Significant digits of a standard deviation (GUM, 7.2.6).
DIGITS = 2


def calibrated_robot(robot: Robot, found: Calibration) -> Robot:
    """
    Return the calibrated robot with its tolerances reduced to the remaining uncertainty.

    A tolerance that several parts share is that of the least certain part.
    """
    left: dict[str, float] = {}
    for part in found.parts:
        name = tolerance_name(part.name)
        left[name] = max(left.get(name, 0.0), part.deviation)
    shrunk = {name: min(float(f'{std:.{DIGITS}g}'), getattr(robot.tolerances, name))
              for name, std in left.items()}
    return replace(found.robot, tolerances=replace(robot.tolerances, **shrunk))


def tolerance_name(part: str) -> str:
    """Return the name of the tolerance that gives a part's prior."""
    name = part.split(':')[0]
    kind = name if name in TOLERANCE_OF else name.split('_strain_')[0].removesuffix('_1')
    kind = kind.removesuffix('_2')
    return TOLERANCE_OF.get(kind, kind)


def calibration_text(found: Calibration) -> str:
    """Return the results as text, one row for each part, and which of them are doubted."""
    lines = [f'{"part":<24}{"tolerance":>14}{"found":>28}']
    for part in found.parts:
        told = f'± {_size(part.prior, part.unit)}'
        lines.append(f'  {part.name:<22}{told:>14}{_size(part.mean, part.unit, "+"):>15} '
                     f'± {_size(part.deviation, part.unit)}'
                     f'{"" if notable(part) else "   left as told"}')
    far = [part.name for part in found.parts if abs(part.mean) > DOUBTED * part.prior]
    if far:
        lines.append(f'more than {DOUBTED:g} tolerances off: {", ".join(far)}; a tolerance is too '
                     'small, or something else is wrong, which flex_diagnose may name')
    return '\n'.join(lines)


def _size(value: float, unit: str, sign: str = '') -> str:
    """Return a deviation as text with its unit, or in percent."""
    return f'{value:{sign}.2g} {unit}' if unit else f'{100.0 * value:{sign}.2f} %'
