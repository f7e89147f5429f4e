"""
The section `inputs:` of a robot file.

It maps the names, signs, units, scales and offsets of incoming measurements to the project's own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import sys
from typing import Any

from flex_plant_sim.arm.file_section import PLAUSIBLE, Section, shown
from msg_config.errors import InputError
from msg_config.input_mapping import (
    ANGLE_UNITS,
    InputMapping,
    JOINTS,
    Source,
    STRAIN_UNITS,
    TIME_UNITS,
)

# Least and largest factor to SI: from a count that is the least noise of a channel, of strain, to
# a command of 1 that is the largest command limit.
FACTORS = PLAUSIBLE['strain_noise'][0], PLAUSIBLE['command_limit'][1]
# Largest offset, in SI. Beside more, doubles do not hold a channel's least noise; commands have
# none, and the offset of one is a command.
OFFSETS = {'joints': PLAUSIBLE['angle_noise_rad'][0] / sys.float_info.epsilon,
           'gauges': PLAUSIBLE['strain_noise'][0] / sys.float_info.epsilon,
           'commands': PLAUSIBLE['command_limit'][1]}
TOPICS = ('joint_states', 'strain', 'command')


def inputs_of(section: Section, gauges: Sequence[str]) -> InputMapping:
    """
    Return the mapping that a robot file's section `inputs` describes.

    Each channel is a name, or a mapping of name, unit, sign (1, -1), scale and offset (in SI):
    SI value = sign x scale x unit x incoming value + offset.

    Raises
    ------
    InputError
        Names the key, what was expected and what was found.

    """
    mapping = InputMapping(
        _read_sources(section, 'joints', JOINTS, ANGLE_UNITS),
        _read_sources(section, 'commands', JOINTS, {}),
        _read_sources(section, 'gauges', gauges, STRAIN_UNITS), _read_topics(section),
        _read_time(section))
    section.close()
    _check_columns(section, mapping.columns(gauges))
    return mapping


def _check_columns(section: Section, columns: Mapping[str, str]) -> None:
    """Raise InputError where two keys have one name; `columns` holds their names in CSV."""
    keys: dict[str, str] = {}
    for key, name in columns.items():
        if name in keys:
            raise InputError(f'{section.source}: {section.path}: expected each name once, got '
                             f'{name!r} for {keys[name]} and {key}')
        keys[name] = key


def _read_sources(section: Section, kind: str, channels: Sequence[str],
                  units: Mapping[str, float]) -> dict[str, Source]:
    group = section.section(kind, {})
    found = {name: _read_source(group, name, units, OFFSETS[kind])
             for name in channels if name in group.data}
    for name in channels:
        group.take(name, {})
    group.close()
    return found


def _read_source(group: Section, key: str, units: Mapping[str, float], most: float) -> Source:
    """Return the source of a channel whose offset is at most so large, in SI."""
    value: Any = group.data[key]
    section = Section(group.source, f'{group.path}.{key}',
                      value if isinstance(value, dict) else {'name': value})
    name, factor = section.text('name', key), _read_factor(section, units)
    factor *= _read_choice(section, 'sign', {'1': 1.0, '-1': -1.0}, '1')
    offset = section.number('offset', float('-inf'), 0.0)
    if abs(offset) > most:
        raise InputError(f'{section.name("offset")}: expected {-most:g} to {most:g}, got '
                         f'{offset:g}')
    section.close()
    return Source(name, factor, offset)


def _read_factor(section: Section, units: Mapping[str, float]) -> float:
    """Return the factor of a section's scale and unit to SI; `units` begins with the default."""
    scale = section.number('scale', default=1.0)
    unit = _read_choice(section, 'unit', units, next(iter(units))) if units else 1.0
    least, most = (factor / unit for factor in FACTORS)
    if not least <= scale <= most:
        raise InputError(f'{section.name("scale")}: expected {least:g} to {most:g}, got {scale:g}')
    return scale * unit


def _read_choice(section: Section, key: str, choices: Mapping[str, float], default: str) -> float:
    value = section.take(key, default)
    if str(value) not in choices:
        raise InputError(f'{section.name(key)}: expected {", ".join(choices)}, got {shown(value)}')
    return choices[str(value)]


def _read_topics(section: Section) -> dict[str, str]:
    group = section.section('topics', {})
    found = {name: group.text(name) for name in TOPICS if name in group.data}
    group.close()
    return found


def _read_time(section: Section) -> Source:
    value = section.take('time', 'time')
    own = Section(section.source, f'{section.path}.time',
                  value if isinstance(value, dict) else {'name': value})
    name, known = own.text('name', 'time'), bool({'unit', 'scale'} & set(own.data))
    factor = _read_factor(own, TIME_UNITS)
    own.close()
    return Source(name, factor if known else 0.0)


def inputs_document(mapping: InputMapping) -> dict[str, Any]:
    """
    Return the section that inputs_of reads as this mapping, with scales to SI units.

    Entries that equal the default are left out, so the default mapping gives an empty section.
    """
    found: dict[str, Any] = {
        kind: {key: {'name': source.name, 'scale': abs(source.factor),
                     'sign': 1 if source.factor > 0.0 else -1, 'offset': source.offset}
               for key, source in group.items()}
        for kind, group in (('joints', mapping.joints), ('commands', mapping.commands),
                            ('gauges', mapping.gauges)) if group}
    if mapping.topics:
        found['topics'] = dict(mapping.topics)
    if mapping.time != InputMapping().time:
        scale = {'scale': mapping.time.factor} if mapping.time.factor else {}
        found['time'] = {'name': mapping.time.name, **scale}
    return found
