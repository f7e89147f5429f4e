"""
A YAML reader for files from untrusted sources, under the readers of robot and other files.

Size, depth and aliases are bounded, a key may stand once, and numbers are read as written.
"""

from __future__ import annotations

from dataclasses import dataclass
import re
from typing import Any

from msg_config.errors import InputError
import yaml

# Limits in characters, levels and values. A robot file has about two thousand characters, fifty
# values and a depth of four; PyYAML reads some thirty thousand characters a second.
MAX_TEXT, MAX_DEPTH, MAX_VALUES = 64_000, 20, 10_000
YAML_TAG = 'tag:yaml.org,2002:'
# 010 is eight in YAML 1.1 and ten in YAML 1.2, so it is not read as a number.
NUMBER = re.compile(r'[-+]?(?!0[0-9]+$)(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?')
SPECIAL = re.compile(r'[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)')
CONSTANTS = {'true': True, 'false': False, 'null': None, '~': None, '': None}


class _Loader(yaml.SafeLoader):
    """Composes nodes to a bounded depth; _Builder then decides what plain text means."""

    yaml_implicit_resolvers: dict[str, Any] = {}
    depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise InputError(f'expected at most {MAX_DEPTH} levels')
        try:
            return super().compose_node(parent, index)
        finally:
            self.depth -= 1


@dataclass
class _Builder:
    """Turns nodes into plain data; an aliased value counts once for each use."""

    values: int = 0

    def build(self, node: Any, depth: int = 0) -> Any:
        self.values += 1
        if self.values > MAX_VALUES or depth > MAX_DEPTH:
            raise InputError(f'expected at most {MAX_VALUES} values, {MAX_DEPTH} levels deep')
        kind = str(node.tag).removeprefix(YAML_TAG)
        if isinstance(node, yaml.MappingNode) and kind == 'map':
            return self._mapping(node, depth)
        if isinstance(node, yaml.SequenceNode) and kind == 'seq':
            return [self.build(item, depth + 1) for item in node.value]
        if isinstance(node, yaml.ScalarNode) and kind in ('str', 'int', 'float'):
            return node.value if node.style else _scalar(node.value)
        raise InputError(f'line {_line_of(node)}: tag {str(node.tag)[:60]!r} is not read')

    def _mapping(self, node: Any, depth: int) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key, value in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise InputError(f'line {_line_of(key)}: expected a word as key')
            if key.value in found:
                raise InputError(f'line {_line_of(key)}: key {key.value[:60]!r}: expected once, '
                                 'got twice')
            found[key.value] = self.build(value, depth + 1)
        return found


def _line_of(node: Any) -> int:
    return int(node.start_mark.line) + 1


def _scalar(text: str) -> Any:
    if text.lower() in CONSTANTS:
        return CONSTANTS[text.lower()]
    if NUMBER.fullmatch(text) and len(text) <= 60:
        return int(text) if text.lstrip('+-').isdigit() else float(text)
    if SPECIAL.fullmatch(text):
        return float(text.replace('.', '', 1))
    return text


def read_yaml(text: str, source: str) -> Any:
    """
    Return the plain data in a YAML text: mappings, lists, text, numbers, true, false, null.

    2.05e11 is a number, unlike in YAML 1.1; yes, 1:30, 010 and 2020-01-01 are text.

    Raises
    ------
    InputError
        The text is no YAML, too large or too deep, repeats a key or has a tag; in one line.

    """
    if len(text) > MAX_TEXT:
        raise InputError(f'{source}: expected at most {MAX_TEXT} characters, got {len(text)}')
    loader = None
    try:
        loader = _Loader(text)
        return _Builder().build(loader.get_single_node() or yaml.ScalarNode(f'{YAML_TAG}str', ''))
    except InputError as error:
        raise InputError(f'{source}: {error}') from None
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError, IndexError) as error:
        line = ' '.join(str(error).split())
        raise InputError(f'{source}: expected YAML, got: {line}') from None
    finally:
        if loader is not None:
            loader.dispose()
