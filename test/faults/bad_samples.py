"""Samples that no arm can have made, and malformed messages: one change of a message per kind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Spoil = Callable[[Any], None]


def number(field: str, index: int, value: float) -> Spoil:
    """Return a change that puts a value into a field."""
    def spoil(message: Any) -> None:
        getattr(message, field)[index] = value
    return spoil


def whole(field: str, values: Any) -> Spoil:
    """Return a change that replaces a field."""
    def spoil(message: Any) -> None:
        setattr(message, field, values)
    return spoil


def stamp(seconds: int | None = None, nanoseconds: int | None = None, later: int = 0) -> Spoil:
    """Return a change of the stamp, s and ns."""
    def spoil(message: Any) -> None:
        own = message.header.stamp
        own.sec = (own.sec if seconds is None else seconds) + later
        own.nanosec = own.nanosec if nanoseconds is None else nanoseconds
    return spoil


def off(field: str, index: int, by: float) -> Spoil:
    """Return a change that adds to a value, as the arm could move in a sample or a little more."""
    def spoil(message: Any) -> None:
        getattr(message, field)[index] += by
    return spoil


NAN, INF = float('nan'), float('inf')
JOINT_STATES: dict[str, Spoil] = {
    'angle 1e9': number('position', 0, 1e9), 'angle 1e30': number('position', 1, 1e30),
    'angle 1e4': number('position', 1, 1e4), 'angle -1e4': number('position', 0, -1e4),
    'angle 20': number('position', 0, 20.0), 'angle 1000': number('position', 1, 1000.0),
    'angle +0.9': off('position', 0, 0.9), 'angle -0.3': off('position', 1, -0.3),
    'angle nan': number('position', 0, NAN), 'angle inf': number('position', 1, INF),
    'effort 1e308': number('effort', 0, 1e308), 'effort -1e308': number('effort', 1, -1e308),
    'effort +9': off('effort', 0, 9.0), 'effort -150': off('effort', 1, -150.0),
    'effort 1e6': number('effort', 1, 1e6), 'effort nan': number('effort', 0, NAN),
    'effort inf': number('effort', 1, INF), 'velocity 1e308': number('velocity', 0, 1e308),
    'one angle': whole('position', [0.1]), 'three angles': whole('position', [0.1, 0.2, 0.3]),
    'no angle': whole('position', []), 'one effort': whole('effort', [0.1]),
    'no names': whole('name', []), 'other names': whole('name', ['a', 'b']),
    'a name twice': whole('name', ['joint_1', 'joint_1']),
    'nanosec 2e9': stamp(nanoseconds=2_000_000_000),
    'nanosec 4e9 at the end of time': stamp(2**31 - 1, 4_000_000_000),
    'before 1970': stamp(-1), 'a second ahead': stamp(later=2), 'a year ahead': stamp(later=10**7),
    'long ago': stamp(0, 0)}
STRAIN: dict[str, Spoil] = {
    'strain 1': number('position', 0, 1.0), 'strain 100': number('position', 1, 100.0),
    'strain -1': number('position', 2, -1.0), 'strain 1e300': number('position', 3, 1e300),
    'strain +0.005': off('position', 0, 0.005), 'strain -0.001': off('position', 2, -0.001),
    'strain +0.0002': off('position', 1, 0.0002),
    'strain nan': number('position', 0, NAN), 'strain inf': number('position', 2, INF),
    'three strains': whole('position', [0.0] * 3), 'strain without names': whole('name', []),
    'strain nanosec 2e9': stamp(nanoseconds=2_000_000_000),
    'strain a year ahead': stamp(later=10**7), 'strain long ago': stamp(0, 0)}
BAD_SAMPLES: dict[str, tuple[str, Spoil]] = {
    **{kind: ('joint_states', spoil) for kind, spoil in JOINT_STATES.items()},
    **{kind: ('strain', spoil) for kind, spoil in STRAIN.items()}}
