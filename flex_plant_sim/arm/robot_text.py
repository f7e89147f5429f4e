"""Writes new numbers into the text of a user's robot file and keeps its comments and order."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
import math
import re
from typing import Any

from flex_plant_sim.arm.inputs_section import inputs_document
from flex_plant_sim.arm.robot import Link, Robot, UNLIMITED
from flex_plant_sim.arm.robot_file import parse_robot
from msg_config.errors import InputError
import yaml

# Significant digits of a written number: no part of an arm is known better.
DIGITS = 6
# The key `effects:` at the start of a line and everything that is indented below it.
EFFECTS_BLOCK = re.compile(r'^effects:[^\n]*\n(?:(?:[ \t]+|-)[^\n]*\n|\s*\n(?=[ \t-]))*', re.M)
Path = tuple[str, ...]


def with_numbers(text: str, robot: Robot) -> str:
    """
    Return the text of a robot file with the numbers, tolerances and effects of a robot.

    Numbers that differ are replaced in place, and missing keys are added to their mapping. A drive
    of another kind is rewritten as a whole. So is the whole text if it cannot be edited this way.

    Parameters
    ----------
    text : str
        A valid robot file.
    robot : Robot
        Robot that the new text describes, to six digits.

    """
    wanted = document(robot)
    edited = _edited(text, document(parse_robot(text, 'robot')), wanted)
    edited = EFFECTS_BLOCK.sub('', edited).rstrip('\n') + '\n' + _effects(robot)
    if _describes(edited, robot):
        return edited
    return yaml.safe_dump(_rounded(wanted), sort_keys=False, allow_unicode=True) + _effects(robot)


def _effects(robot: Robot) -> str:
    if not robot.effects:
        return ''
    listed = [{'name': spec.name, 'site': spec.site, **_rounded(spec.values)}
              for spec in robot.effects]
    return yaml.safe_dump({'effects': listed}, sort_keys=False, allow_unicode=True)


def _edited(text: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """Return the text with every value that differs replaced or added, from the end backwards."""
    edits = sorted(_edits(yaml.compose(text, yaml.SafeLoader), old, new, ()),
                   key=lambda edit: edit[0], reverse=True)
    for start, end, words in edits:
        text = text[:start] + words + text[end:]
    return text


def _edits(node: Any, old: Mapping[str, Any], new: Mapping[str, Any], path: Path
           ) -> Iterator[tuple[int, int, str]]:
    """Yield the edits (start, end, new text) of a mapping."""
    there = {key.value: value for key, value in node.value}
    for key, value in new.items():
        was = old.get(key)
        if isinstance(value, Mapping) and isinstance(was, Mapping):
            if _is_mapping_of_kind(there.get(key), was.get('kind')) \
                    and value.get('kind') == was.get('kind'):
                yield from _edits(there[key], was, value, (*path, key))
            elif not _same(was, value):
                yield _replacement(node, there.get(key), key, value)
        elif not _same(was, value):
            yield _replacement(node, there.get(key), key, value)


def _is_mapping_of_kind(node: Any, kind: str | None) -> bool:
    # A mapping may be written in short as its name alone.
    return isinstance(node, yaml.MappingNode) and kind == next(
        (value.value for key, value in node.value if key.value == 'kind'), None)


def _replacement(node: Any, there: Any, key: str, value: Any) -> tuple[int, int, str]:
    words = yaml.safe_dump(_rounded(value), default_flow_style=True, width=10**6,
                           allow_unicode=True).removesuffix('...\n').strip()
    if there is not None:
        # A block mapping ends after the end of its last line, and its first key is on a new line.
        block = isinstance(there, yaml.CollectionNode) and not there.flow_style
        tail = '\n' if block else ''
        return there.start_mark.index, there.end_mark.index, words + tail
    if node.flow_style:
        return node.end_mark.index - 1, node.end_mark.index - 1, f', {key}: {words}'
    first = node.value[0][0].start_mark
    if first.column == 0:
        return node.end_mark.index, node.end_mark.index, f'\n{key}: {words}\n'
    return first.index, first.index, f'{key}: {words}\n{" " * first.column}'


def _short(value: float) -> float:
    return float(f'{value:.{DIGITS}g}')


def _rounded(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_rounded(item) for item in value]
    return _short(value) if isinstance(value, float) else value


def _same(a: Any, b: Any) -> bool:
    return bool(_rounded(a) == _rounded(b))


def _describes(text: str, robot: Robot) -> bool:
    """Return whether a text describes a robot, to the digits that are written."""
    try:
        found = parse_robot(text, 'edited')
    except InputError:
        return False
    listed = [(spec.name, spec.site, _rounded(dict(spec.values))) for spec in robot.effects]
    return (_same(document(found), document(replace(robot, effects=())))
            and listed == [(spec.name, spec.site, _rounded(dict(spec.values)))
                           for spec in found.effects])


def document(robot: Robot) -> dict[str, Any]:
    """Return a robot without its effects as the data that parse_robot reads."""
    inputs = inputs_document(robot.inputs)
    return {
        'name': robot.name,
        'links': {'upper': _link(robot.links[0]), 'lower': _link(robot.links[1])},
        'drives': {'shoulder': _drive(robot, 0), 'elbow': _drive(robot, 1)},
        'elbow': {'mass_kg': robot.elbow_mass, 'inertia_kg_m2': robot.elbow_inertia},
        'payload': {'mass_kg': robot.payload_mass, 'inertia_kg_m2': robot.payload_inertia,
                    'offset_m': robot.payload_offset},
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
