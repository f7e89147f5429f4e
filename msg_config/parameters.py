"""
The table of parameters, from parameters.yaml.

It is the one source for declaration, validation, parameter files and docs/parameters.md. Defaults
that the library has too are the same (test/test_msg_config.py).
"""

from __future__ import annotations

import argparse
from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
import math
import sys
from types import MappingProxyType
from typing import Any, Union

from msg_config.errors import InputError
import yaml

Value = Union[bool, int, float, str, 'tuple[float, ...]', 'tuple[str, ...]']


def _number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _items(value: object, accepts: Callable[[object], bool]) -> bool:
    return isinstance(value, Iterable) and not isinstance(value, (str, bytes, Mapping)) and all(
        accepts(item) for item in value)


def _text(value: object) -> bool:
    return isinstance(value, str)


# Type name: test for accepted values, conversion, and the type's name in errors.
_TYPES: Mapping[str, tuple[Callable[[Any], bool], Callable[[Any], Value], str]] = {
    'bool': (lambda value: isinstance(value, bool), bool, 'true or false'),
    'int': (lambda value: isinstance(value, int) and not isinstance(value, bool), int,
            'an integer'),
    'double': (_number, float, 'a number'),
    'string': (_text, str, 'a text'),
    'double_array': (lambda value: _items(value, _number),
                     lambda value: tuple(float(item) for item in value), 'a list of numbers'),
    # A single text is a list of one: ROS passes `-p effects:=…` without brackets as a string.
    'string_array': (lambda value: _text(value) or _items(value, _text),
                     lambda value: (value,) if _text(value) else tuple(value),
                     'a list of texts'),
}
APPLIES: Mapping[str, str] = {
    'live': 'at once', 'reset': 'at `~/reset`', 'read_only': 'at the start only'}


@dataclass(frozen=True)
class Parameter:
    """
    One parameter, a row of the table.

    Attributes
    ----------
    name, type, default, description
        As in ``parameters.yaml``; type is one of bool, int, double, string, double_array and
        string_array.
    unit : str
        Unit of the value; empty if it has none.
    minimum, maximum : float or None
        Inclusive limits of a number.
    special : float or None
        One more number that is accepted, below them.
    choices : tuple of str
        Allowed texts; empty if any text is allowed.
    applies : str
        When a change takes effect: live, reset (at the node's ~/reset) or read_only (never
        while the node runs).
    needs : Mapping
        Choices of other parameters beside which it changes anything; empty if beside all.

    """

    name: str
    type: str  # noqa: A003
    default: Value
    description: str
    unit: str = ''
    minimum: float | None = None
    maximum: float | None = None
    special: float | None = None
    choices: tuple[str, ...] = ()
    applies: str = 'read_only'
    needs: Mapping[str, Sequence[Value]] = field(default_factory=dict)

    def unmet(self, values: Mapping[str, Value]) -> str:
        """Return which of a node's values lets this parameter change nothing, or ''."""
        return ', '.join(f'{name} {_shown(values[name])}' for name, choices in self.needs.items()
                         if values[name] not in choices)

    @property
    def meaning(self) -> str:
        """The description, with what the parameter needs."""
        only = ''.join(f' Only where {name} is {" or ".join(map(_shown, choices))}.'
                       for name, choices in self.needs.items())
        return f'{self.description}{only}'

    def check(self, value: object) -> Value:
        """
        Return the value in the parameter's type; an int is accepted for a double.

        Raises
        ------
        InputError
            The value has the wrong type, is out of range or is not a choice.

        """
        accepts, convert, _ = _TYPES[self.type]
        if not accepts(value) or not self._within(value):
            raise InputError(f'{self.name}: expected {self.expected}, got {_plain(value)!r}')
        return convert(value)

    @property
    def expected(self) -> str:
        """Accepted values of the parameter in words."""
        if self.choices:
            return ' or '.join(self.choices)
        words = _TYPES[self.type][2]
        if self.minimum is not None:
            words += f' from {_shown(self.minimum)} to {_shown(self.maximum)}'
        words = f'{words} {self.unit}'.rstrip()
        return words if self.special is None else f'{words}, or {_shown(self.special)}'

    def _within(self, value: Any) -> bool:
        if self.choices:
            return value in self.choices
        return self.minimum is None or self.maximum is None or value == self.special or (
            self.minimum <= value <= self.maximum)


def _parameter(name: str, entry: Mapping[str, Any]) -> Parameter:
    names = {'min': 'minimum', 'max': 'maximum'}
    fields = {names.get(key, key): value for key, value in entry.items()}
    fields['choices'] = tuple(fields.get('choices', ()))
    fields['default'] = _TYPES[entry['type']][1](entry['default'])
    return Parameter(name=name, **fields)


@cache
def load_parameters() -> Mapping[str, Mapping[str, Parameter]]:
    """Return the table of every node, common parameters first."""
    text = files('msg_config').joinpath('parameters.yaml').read_text(encoding='utf-8')
    table = yaml.safe_load(text)
    return MappingProxyType({
        node: MappingProxyType({
            name: _parameter(name, entry) for name, entry in {**table['common'], **own}.items()})
        for node, own in table['nodes'].items()})


def check_parameters(node: str, values: Mapping[str, object]) -> dict[str, Value]:
    """
    Return the parameters of a node: given values, checked, and defaults for all others.

    Raises
    ------
    InputError
        A name is not in the node's table, or a value does not fit.

    """
    table = load_parameters()[node]
    for name in values:
        if name not in table:
            raise InputError(f'{node}: {name}: unknown parameter, expected one of '
                             + ', '.join(table))
    try:
        return {name: row.check(values.get(name, row.default)) for name, row in table.items()}
    except InputError as error:
        raise InputError(f'{node}: {error}') from None


def _plain(value: object) -> object:
    # ROS has lists of numbers as arrays.
    return list(value) if isinstance(value, (tuple, array)) else value


def parameter_file() -> str:
    """
    Return a ROS parameter file with all defaults, which rclpy's own parser can read.

    Empty lists are comments, because ROS refuses them: they have no type.
    """
    lines = []
    for node, table in load_parameters().items():
        lines += [f'{node}:', '  ros__parameters:']
        lines += [line for row in table.values() for line in _file_lines(row)]
    return '\n'.join(lines) + '\n'


def _file_lines(row: Parameter) -> list[str]:
    """Return the lines of a parameter, with its description above it."""
    unit = f' [{row.unit}]' if row.unit else ''
    pair = yaml.safe_dump({row.name: _plain(row.default)}, default_flow_style=False).strip()
    absent = '' if row.default != () else '# '
    return [f'    # {row.meaning}{unit} ({row.applies})', f'    {absent}{pair}']


def _shown(value: Value | None) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f'{value:g}'
    return str(_plain(value))


def _limits(row: Parameter) -> str:
    if row.choices:
        return ', '.join(f'`{choice}`' for choice in row.choices)
    special = '' if row.special is None else f'{_shown(row.special)}, or '
    return '' if row.minimum is None else f'{special}{_shown(row.minimum)} … {_shown(row.maximum)}'


def _rows() -> list[tuple[str, Parameter]]:
    tables = load_parameters()
    first, *others = tables.values()
    common = [row for name, row in first.items()
              if all(table.get(name) == row for table in others)]
    own = [(f'`{node}`', row) for node, table in tables.items() for row in table.values()
           if row not in common]
    return [('every node', row) for row in common] + own


def markdown_table() -> str:
    """Return the table in Markdown: common parameters first, then those of each node."""
    lines = ['| node | parameter | type | default | unit | range | a change applies | meaning |',
             '|---|---|---|---|---|---|---|---|']
    lines += [
        f'| {node} | `{row.name}` | {row.type} | `{_shown(row.default)}` | {row.unit} '
        f'| {_limits(row)} | {APPLIES[row.applies]} | {row.meaning} |'
        for node, row in _rows()]
    return '\n'.join(lines)


HEAD = """# Parameters

Made by `python -m msg_config.parameters` from `msg_config/parameters.yaml`, which declares and
checks them. A value out of range is refused; so is a change of what a running node cannot change.
`qos_overrides.TOPIC.publisher.` (or `subscription.`) `history`, `depth`, `reliability` and
`durability`, with the topic's whole name, change its quality of service at the start.

A parameter file with every default, for `--ros-args --params-file`:

```sh
python -m msg_config.parameters --yaml > parameters.yaml
```

"""


def page() -> str:
    """Return the docs page of the parameters, Markdown."""
    return f'{HEAD}{markdown_table()}\n'


def main() -> int:
    """Print the docs page, or with ``--yaml`` a ROS parameter file with the defaults."""
    options = argparse.ArgumentParser(
        prog='python -m msg_config.parameters',
        description='Print the page of the parameters, or with --yaml a parameter file.')
    options.add_argument('--yaml', action='store_true', help='print a parameter file')
    print(parameter_file() if options.parse_args().yaml else page(), end='')
    return 0


if __name__ == '__main__':
    sys.exit(main())
