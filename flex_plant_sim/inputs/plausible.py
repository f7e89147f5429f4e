"""Hints: which unit, sign or clock makes implausible numbers plausible."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
import math
import re

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.inputs.gate import Refusal
from msg_config.input_mapping import TIME_UNITS
import numpy as np

# Two units of time are a factor of a thousand apart: a ratio this far from one belongs to one.
SAME = 30.0
# How many of another unit make one rad, one m/m.
UNITS = {'rad': {180.0 / math.pi: 'degrees'},
         'm/m': {1e6: 'µm/m (microstrain)', 1e3: 'mm/m', 1e2: 'percent'}}
# A model that is off by its payload and its friction still gets the size within this factor.
SIZE = 4.0
# No part of an arm is off by as much.
FAR = 10.0
# Of increments, which forget drift and offsets.
ALIKE = 0.5
# Of a joint that does not follow its command: the model has less than a sixteenth of its motion.
# Simulated arms with a cause have 0.9 and more, a real arm of another make 0.6.
UNLIKE = 0.25
# Of the squared difference from the model that is left where two channels change places: two
# gauges of a link differ by little more than their size. Simulated logs leave 0.3 to 0.7 of it
# where they are exchanged, and more than all where they are not.
BETTER = 0.75


def time_unit(interval: float, expected: float) -> str | None:
    """
    Return the unit in which a sampling interval fits what is expected, or None if none does.

    Parameters
    ----------
    interval : float
        Between samples, as it came.
    expected : float
        The robot file's, s.

    """
    for unit, factor in TIME_UNITS.items():
        if expected / SAME <= interval * factor <= expected * SAME:
            return unit
    return None


def unit_hint(refusal: Refusal) -> str:
    """Return a question that names the unit in which a refused value would pass, or nothing."""
    match = re.search(r'expected (\S+) to (\S+) (rad|m/m), got (\S+)$', refusal.text)
    if match is None:
        return ''
    low, high, value = (float(match[k]) for k in (1, 2, 4))
    fits = [name for factor, name in UNITS[match[3]].items() if low <= value / factor <= high]
    return f' (is it in {fits[0]}? say so under inputs: in the robot file)' if fits else ''


def channel_hints(measured: Array, expected: Array, names: Sequence[str],
                  units: Sequence[str], noise: Array) -> tuple[str, ...]:
    """
    Return, for each channel unlike what its model expects, the unit or the sign that explains it.

    Increments are compared: their correlation tells the sign, the ratio of their sizes the unit.

    Parameters
    ----------
    measured, expected : Array
        (N, m).
    names, units : sequence of str
        Of the channels, m; units as in SI.
    noise : Array
        Standard deviations of the channels, (m,).

    """
    found = list(_exchanged(np.diff(measured, axis=0), np.diff(expected, axis=0), names, units))
    for name, unit, std, own, model in zip(names, units, noise, np.diff(measured, axis=0).T,
                                           np.diff(expected, axis=0).T):
        size, wanted = float(np.linalg.norm(own)), float(np.linalg.norm(model))
        if not (size > 0.0 and wanted > 0.0):
            continue
        alike = float(own @ model) / (size * wanted)
        fits = [text for factor, text in UNITS[unit].items()
                if 1.0 / SIZE < size / wanted / factor < SIZE]
        ratio = size / wanted
        if abs(alike) > ALIKE and (fits or not 1.0 / FAR < ratio < FAR) \
                or not 1.0 / FAR**2 < ratio < FAR**2 \
                or unit == 'rad' and not 1.0 / FAR < ratio < FAR:
            found.append(f'{name}: {size / wanted:.3g} times what the model expects: '
                         + (f'is it in {fits[0]}?' if fits else 'is its scale right, or the '
                            "command's, and is it this column?"))
        elif unit == 'rad' and abs(alike) < UNLIKE and size > 2.0 * std * math.sqrt(len(own)):
            found.append(f'{name}: hardly moves as the model expects (correlation {alike:.2f}): '
                         "is it this column, and the command's column and scale?")
        if alike < -ALIKE:
            found.append(f'{name}: moves against what the model expects (correlation '
                         f'{alike:.2f}): is its sign inverted?')
    return tuple(found)


def _exchanged(measured: Array, expected: Array, names: Sequence[str], units: Sequence[str]
               ) -> Iterator[str]:
    def apart(i: int, j: int) -> float:
        return float(np.sum((measured[:, i] - expected[:, j])**2))
    for i, j in combinations(range(len(names)), 2):
        if units[i] == units[j] and apart(i, j) + apart(j, i) \
                < BETTER * (apart(i, i) + apart(j, j)):
            also = ', or the commands' if units[i] == 'rad' else ''
            yield f'{names[i]} and {names[j]} look exchanged{also}'
