"""
The section `inputs:` of a robot file.

It maps the names, signs, units, scales and offsets of incoming measurements to the project's own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from flex_plant_sim.arm.file_section import Section, shown
from msg_config.errors import InputError
from msg_config.input_mapping import (
    ANGLE_UNITS,
    InputMapping,
    JOINTS,
    Source,
    STRAIN_UNITS,
    TIME_UNITS,
)

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
    found = {name: _read_source(group, name, units) for name in channels if name in group.data}
    for name in channels:
        group.take(name, {})
    group.close()
    return found


def _read_source(group: Section, key: str, units: Mapping[str, float]) -> Source:
    value: Any = group.data[key]
    section = Section(group.source, f'{group.path}.{key}',
                      value if isinstance(value, dict) else {'name': value})
    name, factor = section.text('name', key), section.number('scale', default=1.0)
    if units:
        factor *= _read_choice(section, 'unit', units, next(iter(units)))
    factor *= _read_choice(section, 'sign', {'1': 1.0, '-1': -1.0}, '1')
    source = Source(name, factor, section.number('offset', float('-inf'), 0.0))
    section.close()
    return source


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
    factor = own.number('scale', default=1.0) * _read_choice(own, 'unit', TIME_UNITS, 's')
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
