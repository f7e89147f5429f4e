"""Writes the template of a robot file and its docs page from the table in arm/robot_keys.py."""

from __future__ import annotations

from dataclasses import fields
import math
from textwrap import wrap

from flex_plant_sim.arm.file_section import may_be_zero, plausible
from flex_plant_sim.arm.robot import Tolerances
from flex_plant_sim.arm.robot_keys import (
    EFFECTS_ABOUT,
    Key,
    KEY_GROUPS,
    KeyGroup,
    KIND,
    TOLERANCES,
    TOLERANCES_ABOUT,
)

# Characters per line of the template.
WIDTH = 95
HEAD = (
    'Robot file of a two-link flexible arm that moves in the horizontal plane. Replace the '
    'numbers, keep the keys; their units stand in their names. Angles: shoulder from the x axis '
    'of the base, elbow from the straight arm, both counter-clockwise seen from above. Delete a '
    'line with "left out:" where you have nothing to say. Then run: flex_robot check FILE')


def template() -> str:
    """Return a robot file with a comment for every key."""
    parts = [_comment(HEAD, '')]
    mapping = ''
    for group in KEY_GROUPS:
        for index, place in enumerate(group.places):
            if group.kind and place not in group.examples:
                continue
            outer, _, inner = place.rpartition('.')
            if outer and outer != mapping:
                parts.append(f'{outer}:\n')
            mapping = outer
            parts.append(_block(group, index, inner or place, '  ' if outer else ''))
    parts.append(_tolerances())
    return ''.join(parts)


def _block(group: KeyGroup, index: int, name: str, indent: str) -> str:
    lines = f'{indent}{name}:\n' if name else ''
    inner = f'{indent}  ' if name else indent
    if group.kind:
        lines += _comment(f'One of {KIND}; all their keys: docs/robot_file.md.', inner,
                          index) + f'{inner}kind: {group.kind}\n'
    for key in group.keys:
        text = key.examples[min(index, len(key.examples) - 1)]
        lines += _comment(_words(key), inner, index) + f'{inner}{key.name}: {text}\n'
    return lines


def _words(key: Key) -> str:
    unit = f' [{key.unit}]' if key.unit else ''
    out = f' Left out: {key.default}.' if key.default else ''
    return f'{key.meaning}{unit} {key.measure}{out}'


def _comment(text: str, indent: str, index: int = 0) -> str:
    """Return a comment; it is empty except for the first place of a group of keys."""
    if index:
        return ''
    return ''.join(f'{indent}# {line}\n' for line in wrap(text, WIDTH - len(indent)))


def _tolerances() -> str:
    lines = 'tolerances:\n' + _comment(TOLERANCES_ABOUT.replace('`', '"'), '  ')
    for field in fields(Tolerances):
        value, of = TOLERANCES[field.name]
        lines += f'  {field.name}: {value:g}  # {of}\n'
    return lines


def reference_page() -> str:
    """Return the docs page of the robot file, Markdown."""
    head = ('# Robot file\n\nMade by `flex_robot reference`. A robot file is YAML. SI units stand '
            'in the names of the keys. `flex_robot template` prints one with a comment for every '
            'key. A key without a default must be there. A number outside its range '
            'is refused: a unit or a decimal point is wrong.\n')
    return head + ''.join(_table(group) for group in KEY_GROUPS) + _ending()


def _table(group: KeyGroup) -> str:
    where = ' and '.join(f'`{place}`' for place in group.places if place) or 'the top'
    kind = f' `kind: {group.kind}`.' if group.kind else ''
    rows = ''.join(
        f'| `{key.name}` | {key.unit} | {key.meaning} | {key.measure} | '
        f'{_range(group.places[0], key)} | {key.default} |\n' for key in group.keys)
    return (f'\n## {group.title}\n\nAt {where}.{kind} {group.about}\n\n'
            '| key | unit | meaning | how to measure it | range | default |\n'
            f'|---|---|---|---|---|---|\n{rows}')


def _range(place: str, key: Key) -> str:
    least, most = plausible(place, key.name)
    zero = '0, or ' if may_be_zero(place, key.name) else ''
    return f'{zero}{least:g} … {most:g}' if math.isfinite(most) else ''


def _ending() -> str:
    rows = ''.join(f'| `{field.name}` | {field.default} | {TOLERANCES[field.name][1]} |\n'
                   for field in fields(Tolerances))
    return (f'\n## Tolerances\n\nAt `tolerances`. {TOLERANCES_ABOUT}\n\n'
            f'| key | default | of |\n|---|---|---|\n{rows}'
            f'\n## Effects\n\nAt `effects`. {EFFECTS_ABOUT}\n')
