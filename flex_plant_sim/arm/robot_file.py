"""
The robot's YAML file, read and validated.

It is where a robot enters; units stand in the key names, and everything else is in SI units.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib import resources
import math
import os
from pathlib import Path
import re
from typing import Any

from flex_plant_sim.arm.drive import DCMotor, Drive
from flex_plant_sim.arm.file_section import Section, shown
from flex_plant_sim.arm.inputs_section import inputs_of
from flex_plant_sim.arm.robot import EffectSpec, Link, Robot, Tolerances, UNLIMITED
from flex_plant_sim.arm.safe_yaml import MAX_TEXT, read_yaml
from flex_plant_sim.file_kind import FILE, file_kind, NOTHING
from msg_config.errors import InputError

# Limits of a robot file. The catalogue has fewer effects, counted at every site.
MAX_EFFECTS = 500
# Knots of a table: one every 10 ms of a stroke of ten seconds.
MAX_KNOTS = 1000
# A last line that ends in a number without a line end. The file may have been cut inside the
# number (5.0e-7 to 5.0) and still be a valid robot.
UNTERMINATED_NUMBER = re.compile(r'[^#]*[:\s][-+.]?\d[-+.\deE]*\Z')


def _read_link(section: Section) -> Link:
    length = section.number('length_m')
    link = Link(length, section.number('thickness_m'), section.number('height_m'),
                section.number('youngs_modulus_pa'), section.number('density_kg_per_m3'),
                section.number('damping_ratio'),
                section.number('hub_radius_m', default=0.0),
                section.numbers('gauge_positions_m', 0.0, length))
    if link.thickness > 0.2 * length:
        raise InputError(f'{section.name("thickness_m")}: expected at most a fifth of length_m, '
                         f'{0.2 * length:g}, to be a beam, got {link.thickness:g}')
    if len(link.gauge_positions) > 20:
        raise InputError(f'{section.name("gauge_positions_m")}: expected at most 20 gauges, '
                         f'got {len(link.gauge_positions)}')
    section.close()
    return link


def _read_drive(section: Section) -> Drive:
    kind = section.take('kind')
    if not isinstance(kind, str) or kind not in DRIVE_KINDS:
        raise InputError(f'{section.name("kind")}: expected {" or ".join(DRIVE_KINDS)}, '
                         f'got {shown(kind)}')
    drive = replace(DRIVE_KINDS[kind](section),
                    command_limit=section.number('command_limit', default=math.inf))
    section.close()
    return drive


def _read_velocity_loop(section: Section) -> Drive:
    return Drive.velocity_loop(section.number('inertia_kg_m2'), section.number('time_constant_s'),
                               section.number('gain_rad_per_s'))


def _read_current(section: Section) -> Drive:
    return Drive(section.number('inertia_kg_m2'), section.number('torque_constant_n_m_per_a'),
                 section.number('damping_n_m_s'))


def _read_dc_motor(section: Section) -> Drive:
    return DCMotor(
        section.number('torque_constant_n_m_per_a'), section.number('resistance_ohm'),
        section.number('friction_n_m_s', default=0.0),
        section.number('rotor_inertia_kg_m2'), section.number('amplifier_gain', default=1.0),
        section.number('tacho_gain_v_s', default=0.0),
        section.number('gear_ratio')).drive()


DRIVE_KINDS: Mapping[str, Callable[[Section], Drive]] = {
    'velocity_loop': _read_velocity_loop, 'current': _read_current, 'dc_motor': _read_dc_motor}


def _read_angle_limits(section: Section) -> tuple[float, float]:
    if 'angle_limits_rad' not in section.data:
        return UNLIMITED
    values = section.numbers('angle_limits_rad', -200.0, 200.0)
    if len(values) != 2 or values[0] >= values[1]:
        raise InputError(f'{section.name("angle_limits_rad")}: expected the least and the largest '
                         f'angle, got {shown(list(values))}')
    return values


def _read_effects(source: str, items: Any) -> tuple[EffectSpec, ...]:
    if not isinstance(items, list):
        raise InputError(f'{source}: effects: expected a list, got {shown(items)}')
    if len(items) > MAX_EFFECTS:
        raise InputError(f'{source}: effects: expected at most {MAX_EFFECTS}, got {len(items)}')
    specs = []
    for index, item in enumerate(items):
        section = Section(source, f'effects[{index}]', item)
        name, site = section.text('name'), section.text('site', 'arm')
        values = {str(key): _read_effect_value(section, key) for key in list(section.data)}
        specs.append(EffectSpec(name, site, values))
    return tuple(specs)


def _read_effect_value(section: Section, key: str) -> float | str | tuple[float, ...]:
    """Return a number, the numbers of a list, or the name of a table's variable."""
    if key == 'variable':
        return section.text(key)
    if not isinstance(section.data[key], list):
        # The effect has bounds of its own, unlike those of a part of the same name.
        return section.any_number(key)
    if len(section.data[key]) > MAX_KNOTS:
        raise InputError(f'{section.name(key)}: expected at most {MAX_KNOTS} numbers, '
                         f'got {len(section.data[key])}')
    return section.numbers(key, -math.inf, math.inf)


def _read_tolerances(section: Section) -> Tolerances:
    values = {key: section.number(key, default=default)
              for key, default in vars(Tolerances()).items()}
    section.close()
    return Tolerances(**values)


def _check_last_line(text: str, source: str) -> None:
    *before, last = text.split('\n')
    if UNTERMINATED_NUMBER.match(last):
        raise InputError(f'{source}: line {len(before) + 1}: expected an end of line behind '
                         f'{last[-40:].strip()!r}: the file may be cut in this number; end the '
                         'line if it is whole')


def parse_robot(text: str, source: str) -> Robot:
    """
    Return the robot that a YAML text describes.

    Raises
    ------
    InputError
        Names source and key, what was expected and what was found.

    """
    top = Section(source, '', read_yaml(text, source))
    _check_last_line(text, source)
    links, drives = top.section('links'), top.section('drives')
    elbow, payload = top.section('elbow'), top.section('payload')
    measurement = top.section('measurement')
    upper, lower = _read_link(links.section('upper')), _read_link(links.section('lower'))
    joints = drives.section('shoulder'), drives.section('elbow')
    limits = _read_angle_limits(joints[0]), _read_angle_limits(joints[1])
    robot = Robot(
        name=top.text('name'), source=source, links=(upper, lower),
        drives=(_read_drive(joints[0]), _read_drive(joints[1])),
        elbow_mass=elbow.number('mass_kg'),
        elbow_inertia=elbow.number('inertia_kg_m2'),
        payload_mass=payload.number('mass_kg'),
        payload_inertia=payload.number('inertia_kg_m2', default=0.0),
        payload_offset=payload.number('offset_m', low=-math.inf, default=0.0),
        sample_time=measurement.number('sample_time_s'),
        gauge_amplifier=measurement.number('gauge_amplifier_v_per_strain', default=1.0),
        angle_noise=measurement.number('angle_noise_rad'),
        strain_noise=measurement.number('strain_noise'),
        effects=_read_effects(source, top.take('effects', [])),
        tolerances=_read_tolerances(top.section('tolerances', {})), angle_limits=limits,
        left_out=top.left_out)
    inputs = inputs_of(top.section('inputs', {}), robot.gauge_names)
    for section in (links, drives, elbow, payload, measurement, top):
        section.close()
    return replace(robot, inputs=inputs)


def built_in_robots() -> tuple[str, ...]:
    """Return the names of the robots that ship with the package."""
    folder = resources.files('flex_plant_sim') / 'robots'
    return tuple(sorted(item.name[:-5] for item in folder.iterdir()
                        if item.name.endswith('.yaml')))


def robot_text(name_or_file: str | Path) -> str:
    """
    Return the YAML text of a built-in robot, or of a file.

    Raises
    ------
    InputError
        Neither exists, or the file cannot be read or is too long for a robot file.

    """
    name = str(name_or_file)
    if name in built_in_robots():
        return (resources.files('flex_plant_sim') / 'robots' / f'{name}.yaml').read_text()
    kind = file_kind(name)
    if kind != FILE:
        what = 'which is no file here' if kind == NOTHING else kind
        raise InputError(f'robot: expected one of {", ".join(built_in_robots())} or a YAML '
                         f'file, got {name[:200]!r}, {what}')
    try:
        with open(name, encoding='utf-8-sig') as file:
            text, size = file.read(MAX_TEXT + 1), os.fstat(file.fileno()).st_size
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f'{name}: expected a readable text file, got: {error}') from None
    if len(text) > MAX_TEXT:
        raise InputError(f'{name}: expected a robot file, of at most {MAX_TEXT} characters, got a '
                         f'file of {size} bytes')
    return text


def load_robot(name_or_file: str | Path) -> Robot:
    """
    Return a built-in robot by name, or the robot of a YAML file.

    Raises
    ------
    InputError
        Neither exists, or the file is not a valid robot.

    """
    name = str(name_or_file)
    return parse_robot(robot_text(name),
                       f'{name}.yaml' if name in built_in_robots() else name)
