"""
Converts messages of the contract to arrays and back.

It needs the message packages, but no node.
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
import math
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import InertiaStamped
from msg_config.errors import InputError
from msg_config.time_stamp import NANOSECONDS, valid_stamp
import numpy as np
from numpy.typing import NDArray
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

Array = NDArray[np.float64]
LEVELS = {
    'ok': DiagnosticStatus.OK, 'warn': DiagnosticStatus.WARN, 'error': DiagnosticStatus.ERROR,
    'stale': DiagnosticStatus.STALE}


def nanoseconds(time: float) -> int:
    """Return a time, s, as a stamp in integer nanoseconds."""
    return round(time * NANOSECONDS)


def seconds(stamp: int) -> float:
    """Return the time of a stamp, ns, in s."""
    return stamp / NANOSECONDS


def time_message(stamp: int) -> Time:
    """Return the message of a stamp, ns."""
    whole, rest = divmod(stamp, NANOSECONDS)
    return Time(sec=whole, nanosec=rest)


def stamp_of(message: Any) -> int:
    """Return the stamp of a message with a header, ns."""
    stamp = message.header.stamp
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def checked_time(time: Any, where: str) -> int:
    """
    Return a time in an incoming message, ns; `where` names topic and field for the error.

    Raises
    ------
    InputError
        It is no valid time: before 1970, or with a second or more of nanoseconds.

    """
    whole, rest = time.sec, time.nanosec
    if not valid_stamp(whole, rest):
        raise InputError(f'{where}: expected sec >= 0 and nanosec < 1e9, got {whole} and {rest}')
    return int(whole) * NANOSECONDS + int(rest)


def checked_stamp(message: Any, topic: str) -> int:
    """Return the stamp of an incoming message, ns, as `checked_time` does."""
    return checked_time(message.header.stamp, f'{topic}: header.stamp')


def doubles(values: Sequence[float] | Array) -> array[float]:
    """Return numbers in the type that messages hold."""
    return array('d', values.tolist() if isinstance(values, np.ndarray) else values)


def joint_state(stamp: int, names: Sequence[str], position: Sequence[float] | Array = (),
                velocity: Sequence[float] | Array = (),
                effort: Sequence[float] | Array = ()) -> JointState:
    """Return a JointState; fields left out stay empty."""
    return JointState(
        header=Header(stamp=time_message(stamp)), name=list(names), position=doubles(position),
        velocity=doubles(velocity), effort=doubles(effort))


def check_finite(values: Array, names: Sequence[str], where: str) -> None:
    """
    Check that all values are finite.

    Raises
    ------
    InputError
        A value is not finite; names topic, field and channel.

    """
    # A sum is finite if its terms are; it overflows only for values far from any measurement.
    if math.isfinite(sum(values.tolist())):
        return
    for name, value in zip(names, values):
        if not math.isfinite(value):
            raise InputError(f'{where} of {name}: expected a finite number, got {value}')


def inertia_message(stamp: int, mass: float, prefix: str = '') -> InertiaStamped:
    """Return the payload as a point mass at the tip, in the tip frame, named with a prefix."""
    message = InertiaStamped(header=Header(stamp=time_message(stamp), frame_id=f'{prefix}tip'))
    message.inertia.m = mass
    return message


def payload_mass(message: InertiaStamped) -> float:
    """
    Return the mass in a message, kg.

    Raises
    ------
    InputError
        It is not finite.

    """
    mass = float(message.inertia.m)
    if not math.isfinite(mass):
        raise InputError(f'payload/inertia: inertia.m: expected a finite mass, got {mass}')
    return mass


def clock_message(stamp: int) -> Clock:
    """Return /clock of a stamp, ns."""
    return Clock(clock=time_message(stamp))


def diagnostic_status(name: str, level: str, text: str, values: Mapping[str, object],
                      hardware: str) -> DiagnosticStatus:
    """
    Return one diagnostic status.

    Parameters
    ----------
    name : str
        Node and task, for example 'payload_estimator: model'.
    level : str
        ok, warn, error or stale.
    text : str
        One line for an engineer.
    values : Mapping
        Values by key, which includes the unit.
    hardware : str
        Name of the robot.

    """
    return DiagnosticStatus(
        level=LEVELS[level], name=name, message=text, hardware_id=hardware,
        values=[KeyValue(key=key, value=_shown(value)) for key, value in values.items()])


def diagnostic_array(stamp: int, statuses: Sequence[DiagnosticStatus]) -> DiagnosticArray:
    """Return the array of statuses at a stamp, ns."""
    return DiagnosticArray(header=Header(stamp=time_message(stamp)), status=list(statuses))


def _shown(value: object) -> str:
    return f'{value:.6g}' if isinstance(value, float) else str(value)
