"""
Maps external names to the channels of the arm, and external numbers to SI units.

Nodes and log readers apply it to everything that comes in; the robot file describes it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
import math

from msg_config.errors import InputError
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
JOINTS = ('joint_1', 'joint_2')
# Other names of the joints: those of the drives in the robot file.
JOINT_ALIASES = {'joint_1': ('shoulder',), 'joint_2': ('elbow',)}
# Units by name, as factors to SI.
ANGLE_UNITS = {'rad': 1.0, 'deg': math.pi / 180.0}
# 'ustrain' is the common word for µm/m in laboratories.
STRAIN_UNITS = {'m/m': 1.0, 'mm/m': 1e-3, 'um/m': 1e-6, 'µm/m': 1e-6, 'ustrain': 1e-6}
TIME_UNITS = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9}
# Number of different orders of names that are cached: more than the senders of a topic use.
CACHED_ORDERS = 8


@dataclass(frozen=True)
class Source:
    """
    The external source of a channel.

    Attributes
    ----------
    name : str
        Name in messages, or of the column.
    factor : float
        sign x scale x unit: SI value = factor x external value + offset.
    offset : float
        rad, m/m or the drive's own unit.

    """

    name: str
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Channels:
    """
    Channels of one kind in the arm's order.

    Attributes
    ----------
    own : tuple of str
        The arm's own names, n.
    sources : tuple of tuple of str
        External names that each channel may have, n.
    factor, offset : tuple of float
        SI value = factor x external value + offset, n.

    """

    own: tuple[str, ...]
    sources: tuple[tuple[str, ...], ...]
    factor: tuple[float, ...]
    offset: tuple[float, ...]

    def index(self, given: Sequence[str], where: str) -> list[int]:
        """
        Return the index of each channel among the names given; other names are ignored.

        Raises
        ------
        InputError
            A name is missing, empty or repeated, or a channel has two of its names.

        """
        rows = []
        for own, names in zip(self.own, self.sources):
            found = [k for k, name in enumerate(given) if name in names]
            if len(found) > 1:
                raise InputError(f'{where}: name: expected {own} once, got {_listed(given)}')
            if not found:
                wanted = ', '.join(names[0] for names in self.sources)
                raise InputError(f'{where}: name: expected {wanted}; {names[0]} is missing from '
                                 f'{_listed(given)}')
            rows.append(found[0])
        return rows

    def name_any(self, given: Sequence[str]) -> bool:
        """Return whether one of the names given is that of a channel."""
        return not self._known.isdisjoint(given)

    def pick(self, given: Sequence[str], values: Sequence[float], where: str) -> Array:
        """
        Return the values of one message in SI, (n,), in the arm's order, found by name.

        Parameters
        ----------
        given : sequence of str
            Names of the message, in any order; there may be more than those of the channels.
        values : sequence of float
            One value for each name.
        where : str
            Topic and field, for error messages.

        Raises
        ------
        InputError
            Names and values differ in number, or a name is missing or ambiguous.

        """
        found = self._picked(given, values, where)
        return found if self._in_si else self.si(found)

    def pick_rate(self, given: Sequence[str], values: Sequence[float], where: str) -> Array:
        """Return the rates of change of one message in SI, as `pick` returns its values."""
        found = self._picked(given, values, where)
        return found if self._in_si else self.rate(found)

    def _picked(self, given: Sequence[str], values: Sequence[float], where: str) -> Array:
        if len(values) != len(given):
            raise InputError(f'{where}: expected {len(given)} values, one for each name, '
                             f'got {len(values)}')
        names = tuple(given)
        rows = self._indices.get(names)
        if rows is None:
            rows = self.index(given, where)
            if len(self._indices) >= CACHED_ORDERS:
                self._indices.clear()
            self._indices[names] = rows
        return np.array([values[k] for k in rows], dtype=float)

    @cached_property
    def _indices(self) -> dict[tuple[str, ...], list[int]]:
        """Cache of the indices by names, since messages repeat the same order of names."""
        return {}

    @cached_property
    def _known(self) -> frozenset[str]:
        return frozenset(name for names in self.sources for name in names)

    @cached_property
    def _in_si(self) -> bool:
        return set(self.factor) <= {1.0} and set(self.offset) <= {0.0}

    @cached_property
    def _scale(self) -> tuple[Array, Array]:
        return np.array(self.factor), np.array(self.offset)

    @property
    def names(self) -> tuple[str, ...]:
        """Return the external name of each channel, (n,)."""
        return tuple(names[0] for names in self.sources)

    def outside(self, values: Array) -> Array:
        """Return the external values of SI values, (…, n): the inverse of `si`."""
        return values if self._in_si else (values - self._scale[1]) / self._scale[0]

    def rate_outside(self, values: Array) -> Array:
        """Return the external values of rates of change in SI, (…, n): the inverse of `rate`."""
        return values if self._in_si else values / self._scale[0]

    def si(self, values: Array) -> Array:
        """Return external values, (…, n), in SI; one that is too large for that is infinite."""
        with np.errstate(over='ignore'):
            return values * self._scale[0] + self._scale[1]

    def rate(self, values: Array) -> Array:
        """Return external rates of change, (…, n), in SI, to which the offset does not apply."""
        return values * self._scale[0]


def _listed(names: Sequence[str]) -> str:
    return ', '.join(str(name)[:40] or "''" for name in list(names)[:8]) or 'an empty list'


@dataclass(frozen=True)
class InputMapping:
    """
    The inputs of a robot file; channels that are left out have the contract's names, in SI units.

    Attributes
    ----------
    joints, commands, gauges : Mapping of str to Source
        Sources by joint_1, joint_2 and gauge name.
    topics : Mapping of str to str
        Topic in bags by the contract's name; live topics are remapped by the means of ROS.
    time : Source
        Column of time; with factor 0 the unit is found from the numbers.

    """

    joints: Mapping[str, Source] = field(default_factory=dict)
    commands: Mapping[str, Source] = field(default_factory=dict)
    gauges: Mapping[str, Source] = field(default_factory=dict)
    topics: Mapping[str, str] = field(default_factory=dict)
    time: Source = Source('time', 0.0)

    def joint_channels(self) -> Channels:
        """Return the joints, rad; their velocities have the same names and factors."""
        return _channels(JOINTS, self.joints, JOINT_ALIASES)

    def command_channels(self) -> Channels:
        """Return the commands, which have their own or the joints' names in messages."""
        joints = self.joint_channels()
        names = {own: tuple(dict.fromkeys([
            *([self.commands[own].name] if own in self.commands else []),
            *_left(own, sources, self.commands)]))
            for own, sources in zip(JOINTS, joints.sources)}
        plain = _channels(JOINTS, self.commands, {})
        return Channels(JOINTS, tuple(names[own] for own in JOINTS), plain.factor, plain.offset)

    def columns(self, gauges: Sequence[str]) -> dict[str, str]:
        """
        Return the CSV columns of time, commands, joints and gauges, in this order, by their key.

        A command that has its joint's name, as in messages, stands in command_1 or command_2.
        """
        joints = self.joint_channels()
        named = {own: self.commands[own].name for own in self.commands}
        commands = {
            f'commands.{own}': f'command_{k}' if named.get(own, names[0]) in names else named[own]
            for k, (own, names) in enumerate(zip(JOINTS, joints.sources), start=1)}
        return {'time': self.time.name, **commands,
                **{f'joints.{own}': name for own, name in zip(JOINTS, joints.names)},
                **{f'gauges.{own}': name
                   for own, name in zip(gauges, self.gauge_channels(gauges).names)}}

    def gauge_channels(self, gauges: Sequence[str]) -> Channels:
        """Return the gauges, m/m."""
        return _channels(tuple(gauges), self.gauges, {})


# The contract's own names, in SI.
CONTRACT = InputMapping()


def _left(own: str, names: Sequence[str], said: Mapping[str, Source]) -> tuple[str, ...]:
    """Return the names that are left to a channel: none that the file gives to another one."""
    taken = {source.name for other, source in said.items() if other != own}
    return tuple(name for name in names if name not in taken)


def _channels(own: tuple[str, ...], said: Mapping[str, Source],
              aliases: Mapping[str, tuple[str, ...]]) -> Channels:
    sources = [said.get(name, Source(name)) for name in own]
    names = tuple((source.name,) if name in said else (
        name, *_left(name, aliases.get(name, ()), said)) for name, source in zip(own, sources))
    return Channels(own, names, tuple(source.factor for source in sources),
                    tuple(source.offset for source in sources))
