"""
Hints on implausible measurements: which unit, sign, channel or clock would make them plausible.

The readers and tools that take logs add these hints to their errors and notes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
import math

from flex_plant_sim.arm.file_section import plausible
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.inputs.gate import RANGE, Refusal
from flex_plant_sim.interval import Z95
from flex_plant_sim.tiny import TINY
from msg_config.errors import InputError
from msg_config.input_mapping import TIME_UNITS
import numpy as np

# Relative difference up to which two sampling intervals agree: ten times that of two quartz
# clocks (100 ppm).
SAMPLING_AGREES = 1e-3
# Ratio of two sampling intervals up to which they may have the same unit: about the square root of
# the factor of a thousand between units of time.
SAME_TIME_UNIT = 30.0
# How many of another unit make one rad or one m/m.
DEGREES = {180.0 / math.pi: 'degrees'}
UNITS = {'rad': DEGREES, 'rad/s': DEGREES,
         'm/m': {1e6: 'µm/m (microstrain)', 1e3: 'mm/m', 1e2: 'percent'}}
# How far beyond its bounds, over their distance, a number may be in the right unit: an undamped
# joint that is sent from one to the other overshoots by as much.
OVERSHOOT = 1.0
# Largest ratio of what a channel changes over two rows to what it does over one, where two sources
# alternate: noise has 1, and what moves up to 2.
ALTERNATE = 0.5
# Factor within which a model with a wrong payload and friction still gets the size of a signal:
# strain that follows the model's is within 2.7 beside any effect that is 2.5 times a clear one.
SIZE_TOLERANCE = 4.0
# Ratio of the sizes of joints that no deviation of an arm's parts explains, its square of strain
# that does not follow.
WRONG_SCALE = 10.0
# Least correlation, in magnitude, of a channel that moves as the model does. It is that of the
# increments, which do not depend on drift and offsets.
FOLLOWS = 0.5
# Factor on the told standard deviation of noise from which it is said. Healthy sensors of shared
# records have up to 1.1, 1.2 and 2.2 at 100, 50 and 25 Hz, as differences of slow samples hold
# motion.
NOTED_FACTOR = 3.0
# Below this correlation a joint does not follow its command: the model explains less than a
# sixteenth of its motion. Simulated arms with a cause have 0.9 and more, a real arm of another
# make 0.6.
UNRELATED = 0.25
# Two channels look exchanged if exchanging them leaves each less than this share of its squared
# difference from the model. Simulated logs leave 0.3 to 0.7 of it if channels are exchanged, and
# more than 1 if not.
EXCHANGE_GAIN = 0.75
# How many times better the strain has to be explained with a joint reversed. Of 92 simulated arms
# of two robots, most with an effect, none is 1.3 times better without being reversed. Of those
# that are, 44 of the reference robot's 46 are 1.5 times better, and few of the Quanser's, as its
# links hardly couple (finite elements, seeds 1207000 on).
REVERSED = 1.5
# Variance of the logarithm of the ratio of two gauges' scales, each known to 10 %, and what an
# exchange costs beside a wrong scale, nats: as much as a cause of the catalogue.
RATIO_VARIANCE, EXCHANGE_PRICE = 2.0 * 0.1**2, 4.0


def time_unit(interval: float, expected: float) -> str | None:
    """
    Return the unit of a sampling interval: in which it is the expected one, or s if that is near.

    None if neither; nothing then tells a clock in another unit from a count of the rows.

    Parameters
    ----------
    interval : float
        Time between samples, in the unknown unit.
    expected : float
        Sampling interval of the robot file, s.

    """
    for unit, factor in TIME_UNITS.items():
        if abs(interval * factor - expected) <= SAMPLING_AGREES * expected:
            return unit
    return 's' if 1.0 / SAME_TIME_UNIT <= interval / expected <= SAME_TIME_UNIT else None


def check_sampling(where: str, interval: float, robot: Robot, told: str) -> None:
    """
    Check a sampling interval, s, against the robot file's and all that one may have.

    Parameters
    ----------
    where : str
        Log and channel, for the error.
    interval : float
        s.
    robot : Robot
        Gives the sample time.
    told : str
        What the unit is known from, and is to be looked at.

    Raises
    ------
    InputError
        The interval is in no unit that is plausible; names both.

    """
    least, most = plausible('measurement', 'sample_time_s')
    low = max(least, robot.sample_time / SAME_TIME_UNIT)
    high = min(most, robot.sample_time * SAME_TIME_UNIT)
    # The ends may be met to the last digit.
    if not low * (1.0 - SAMPLING_AGREES) <= interval <= high * (1.0 + SAMPLING_AGREES):
        raise InputError(f'{where}: expected a sample every {low:.3g} to {high:.3g} s, as '
                         f'sample_time_s of {robot.source} is {robot.sample_time:g} s, got one '
                         f'every {interval:.6g} s: is {told} right?')


def alternates(channel: Array) -> bool:
    """Return whether the rows of a channel, (N,), look like those of two sources in turn."""
    over_one, over_two = (np.nansum(np.abs(channel[n:] - channel[:-n])) for n in (1, 2))
    return bool(over_two < ALTERNATE * over_one)


def unit_hint(refusal: Refusal) -> str:
    """Return a question that names the units in which a refused value would pass, or ''."""
    if not refusal.unit:
        return (' (in another unit? scale it under inputs: in the robot file)'
                if refusal.kind == RANGE else '')
    fits = [name for factor, name in UNITS.get(refusal.unit, {}).items()
            if refusal.excess > OVERSHOOT
            and refusal.low <= refusal.value / factor <= refusal.high]
    return (f' (is it in {" or ".join(fits)}? say so under inputs: in the robot file)'
            if fits else '')


def channel_hints(measured: Array, expected: Array, names: Sequence[str],
                  units: Sequence[str], noise: Array) -> tuple[str, ...]:
    """
    Return a hint for each channel that disagrees with the model: unit, sign, scale or exchange.

    Increments are compared: their correlation tells the sign, the ratio of their sizes the unit.
    A channel may be noisier than told by what is not noted, and is too large without that.

    Parameters
    ----------
    measured, expected : Array
        (N, m).
    names, units : sequence of str
        Names and SI units of the m channels.
    noise : Array
        Standard deviations of the channels' noise as told, (m,).

    """
    found = list(_exchanged(np.diff(measured, axis=0), np.diff(expected, axis=0), names, units))
    for name, unit, std, own, model in zip(names, units, noise, np.diff(measured, axis=0).T,
                                           np.diff(expected, axis=0).T):
        size, wanted = float(np.linalg.norm(own)), float(np.linalg.norm(model))
        if not (size > 0.0 and wanted > 0.0):
            continue
        least = _beyond_noise(own, NOTED_FACTOR * std)
        correlation = float(own @ model) / (size * wanted)
        ratio, follows = size / wanted, abs(correlation) > FOLLOWS
        apart = WRONG_SCALE if unit == 'rad' else SIZE_TOLERANCE if follows else WRONG_SCALE**2
        fits = [text for factor, text in UNITS[unit].items()
                if 1.0 / SIZE_TOLERANCE < ratio / factor < SIZE_TOLERANCE]
        if ratio <= 1.0 / apart or least >= apart * wanted:
            found.append(f'{name}: {ratio:.3g} times what the model expects: '
                         + (f'is it in {fits[0]}?' if fits else 'is its scale right, or the '
                            "command's, and is it this column?"))
        elif unit == 'rad' and abs(correlation) < UNRELATED and least > 0.0:
            found.append(f'{name}: hardly moves as the model expects (correlation '
                         f"{correlation:.2f}): is it this column, and the command's column and "
                         'scale?')
        if correlation < -FOLLOWS:
            also = ", or its command's," if unit == 'rad' else ''
            found.append(f'{name}: moves against what the model expects (correlation '
                         f'{correlation:.2f}): is its sign{also} inverted?')
    return tuple(found)


def inverted(measured: Array, expected: Array) -> Array:
    """Return whether each channel, of (N, m), moves rather against what is expected, (m,)."""
    return np.sum(np.diff(measured, axis=0) * np.diff(expected, axis=0), axis=0) < 0.0


def reversal_gain(measured: Array, expected: Array, other: Array) -> float:
    """
    Return how many times better strain is explained by other outputs, (N, m), where joints are.

    By what is left of its increments, each gauge's as a share of its own and with the better of
    both signs. 0 where a joint moves against what is expected: that has a hint of its own.
    """
    own, *both = (np.diff(x, axis=0) for x in (measured, expected, other))
    size = np.sum(own**2, axis=0)
    alive = size[2:] > 0.0
    if inverted(measured, expected)[:2].any() or not alive.any():
        return 0.0
    left = [np.minimum(*(np.sum((own - sign * model)**2, axis=0) for sign in (1.0, -1.0)))
            for model in both]
    without, reverse = (float(np.sum(x[2:][alive] / size[2:][alive])) for x in left)
    return without / max(reverse, TINY)


def _beyond_noise(increments: Array, std: float) -> float:
    """
    Return the least size of what of a channel's increments, (N,), is not its white noise.

    Noise adds 2 N std^2 to their sum of squares, with the variance 12 N std^4, as neighbours share
    a value, and no more than 16 std^2 times the signal's own sum, as no direction of increments
    varies by more than 4 std^2.
    """
    count, variance = len(increments), std**2
    signal = float(increments @ increments) - 2.0 * count * variance
    error = math.sqrt(12.0 * count * variance**2 + 16.0 * variance * max(signal, 0.0))
    return math.sqrt(max(signal - Z95 * error, 0.0))


def _sizes_exchanged(found: float, wanted: float) -> bool:
    """
    Return whether two gauges of a link look exchanged, by the logarithm of the ratio of sizes.

    They bend alike but for their size, and a wrong payload changes both alike. So an exchange has
    to fit within two deviations of the gauges' scales, and to gain more than its price.
    """
    gain = -2.0 * found * wanted / RATIO_VARIANCE
    return abs(found + wanted) < 2.0 * RATIO_VARIANCE**0.5 and gain > EXCHANGE_PRICE


def _exchanged(measured: Array, expected: Array, names: Sequence[str], units: Sequence[str]
               ) -> Iterator[str]:
    def squared_difference(i: int, j: int) -> float:
        # With the better of both signs, as an inverted channel is not an exchanged one.
        return min(float(np.sum((measured[:, i] - sign * expected[:, j])**2))
                   for sign in (1.0, -1.0))
    # A dead channel is like none; one that should be zero throughout has a logarithm, too.
    alive = np.flatnonzero(measured.any(axis=0)).tolist()
    size, wanted = (np.log(np.maximum(np.linalg.norm(x, axis=0), TINY))
                    for x in (measured, expected))

    def looks_exchanged(i: int, j: int) -> bool:
        # Of one link, as strain_1a and strain_1b.
        if units[i] == 'm/m' and names[i][-1].isalpha() and names[i][:-1] == names[j][:-1]:
            return _sizes_exchanged(size[i] - size[j], wanted[i] - wanted[j])
        # Each is more like the other: joints that move alike leave one of the two worse.
        return all(squared_difference(a, b) < EXCHANGE_GAIN * squared_difference(a, a)
                   for a, b in ((i, j), (j, i)))
    for i, j in combinations(alive, 2):
        if units[i] == units[j] and looks_exchanged(i, j):
            also = ', or the commands' if units[i] == 'rad' else ''
            yield f'{names[i]} and {names[j]} look exchanged{also}'
