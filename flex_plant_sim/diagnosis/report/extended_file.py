"""Writes the extended robot: the user's file with the causes found added under `effects:`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
import math
from pathlib import Path
import re
from typing import Any

from flex_plant_sim.arm.inputs_section import inputs_document
from flex_plant_sim.arm.robot import EffectSpec, Link, Robot, UNLIMITED
from flex_plant_sim.arm.robot_file import parse_robot, robot_text
from flex_plant_sim.atomic_file import MARK, whole_file
from flex_plant_sim.effects.base import Effect
from msg_config.errors import InputError
import yaml

# The key `effects:` at the start of a line and everything that is indented below it.
EFFECTS_BLOCK = re.compile(r'^effects:[^\n]*\n(?:(?:[ \t]+|-)[^\n]*\n|\s*\n(?=[ \t-]))*', re.M)


def specs(effects: Sequence[Effect]) -> tuple[EffectSpec, ...]:
    """Return effects in the form in which a robot file holds them."""
    return tuple(EffectSpec(e.identifier, e.site, e.written()) for e in effects)


def extended_text(source: str | Path, robot: Robot, effects: Sequence[Effect]) -> str:
    """
    Return the YAML text of an extended robot.

    The user's text, with its comments, is kept if only effects were added. Otherwise the file is
    rewritten with the same keys.

    Parameters
    ----------
    source : str or Path
        Built-in robot or file that was extended.
    robot : Robot
        Robot with the parameters to write; its effects are ignored.
    effects : sequence of Effect
        All effects, including those of the user's file.

    """
    text = robot_text(source)
    original = parse_robot(text, str(source))
    wanted = replace(robot, effects=specs(effects))
    listed = yaml.safe_dump({'effects': [
        {'name': spec.name, 'site': spec.site, **{
            key: list(value) if isinstance(value, tuple) else value
            for key, value in spec.values.items()}} for spec in wanted.effects]},
        sort_keys=False, allow_unicode=True)
    if replace(original, effects=()) == replace(robot, effects=()):
        kept = EFFECTS_BLOCK.sub('', text).rstrip('\n') + '\n' + listed
        if _parses_to(kept, wanted):
            return kept
    return yaml.safe_dump(document(robot), sort_keys=False, allow_unicode=True) + listed


def _parses_to(text: str, wanted: Robot) -> bool:
    try:
        return parse_robot(text, 'extended') == wanted
    except InputError:
        return False


def write_extended(path: str | Path, source: str | Path, robot: Robot,
                   effects: Sequence[Effect]) -> None:
    """
    Write an extended robot, whole or not at all; see extended_text.

    Raises
    ------
    InputError
        Nothing can be written there, the source cannot be read, or no robot file may say so.

    """
    text = extended_text(source, robot, effects)
    parse_robot(text, f'{path}: extended robot, not written')
    with whole_file(path) as temporary:
        temporary.write_text(text if MARK in text else f'{text}# {MARK}\n', encoding='utf-8')


def document(robot: Robot) -> dict[str, Any]:
    """Return a robot without its effects as the data that parse_robot reads."""
    inputs = inputs_document(robot.inputs)
    return {
        'name': robot.name,
        'links': {'upper': _link(robot.links[0]), 'lower': _link(robot.links[1])},
        'drives': {'shoulder': _drive(robot, 0), 'elbow': _drive(robot, 1)},
        'elbow': {'mass_kg': robot.elbow_mass, 'inertia_kg_m2': robot.elbow_inertia},
        'payload': {'mass_kg': robot.payload_mass, 'inertia_kg_m2': robot.payload_inertia},
        'measurement': {
            'sample_time_s': robot.sample_time,
            'gauge_amplifier_v_per_strain': robot.gauge_amplifier,
            'angle_noise_rad': robot.angle_noise, 'strain_noise': robot.strain_noise},
        'tolerances': asdict(robot.tolerances), **({'inputs': inputs} if inputs else {})}


def _link(link: Link) -> dict[str, Any]:
    return {
        'length_m': link.length, 'thickness_m': link.thickness, 'height_m': link.height,
        'youngs_modulus_pa': link.youngs_modulus, 'density_kg_per_m3': link.density,
        'damping_ratio': link.damping_ratio, 'hub_radius_m': link.hub_radius,
        'gauge_positions_m': list(link.gauge_positions)}


def _drive(robot: Robot, index: int) -> dict[str, Any]:
    drive = robot.drives[index]
    found: dict[str, Any] = {'inertia_kg_m2': drive.inertia}
    if drive.closed_loop:
        found |= {'kind': 'velocity_loop', 'time_constant_s': drive.inertia / drive.damping,
                  'gain_rad_per_s': drive.torque_gain / drive.damping}
    else:
        found |= {'kind': 'current', 'torque_constant_n_m_per_a': drive.torque_gain,
                  'damping_n_m_s': drive.damping}
    if math.isfinite(drive.command_limit):
        found['command_limit'] = drive.command_limit
    if robot.angle_limits[index] != UNLIMITED:
        found['angle_limits_rad'] = list(robot.angle_limits[index])
    return found
