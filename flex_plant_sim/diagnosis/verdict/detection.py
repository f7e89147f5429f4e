"""Detection limits: the size of each effect at which a record's evidence turns."""

from __future__ import annotations

from collections.abc import Sequence
import math

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.promise import Closer, Promise
from flex_plant_sim.diagnosis.likelihood.evidence import detectable
from flex_plant_sim.diagnosis.likelihood.prior import factors_on_parts, log_odds
from flex_plant_sim.diagnosis.pool import each
import numpy as np

# Each halves the interval of the logarithm between two looks: 1e-6 is left.
ITERATIONS = 20
# Looks nearer by, and what is far: information is interpolated between sizes.
CLOSER, FAR = 2, 0.7
# Halvings, on a logarithm, of what parts sizes that change nothing from those that show.
HALVINGS = 4


def detection_limits(promises: Sequence[Promise], robot: Robot, duration: float,
                     closer: Closer, jobs: int = 1) -> dict[str, tuple[float, str]]:
    """
    Return 'identifier:site' to (smallest deviation from null, unit); inf where none shows.

    A size shows when the effect with it would be more probable than nothing in its place.

    Parameters
    ----------
    promises : sequence of Promise
        What each hypothesis could add to the causes that are on.
    robot : Robot
        Whose sites share an effect's odds.
    duration : float
        Of the longest record, s.
    closer : Closer
        Looks again where a limit is far below the sizes that were looked at: there, parts may
        do what the effect does.
    jobs : int
        Processes.

    """
    for number in range(CLOSER + HALVINGS):
        items = [(p, _closer_by(p, robot, duration, number < CLOSER)) for p in promises]
        far = [(p, size) for p, size in items if size is not None]
        again = {p.hypothesis: p for p in each(closer, far, jobs)}
        promises = [again.get(p.hypothesis, p) for p in promises]
    found: dict[str, tuple[float, str]] = {}
    for p in promises:
        size, (hidden, shown) = _limit(p, robot, duration), _shown(p)
        # What changes nothing at some size shows first between that and the next.
        least = size if hidden == 0.0 else max(size, shown)
        limit = (least, p.hypothesis.parameters[_size(p)].unit)
        # Of what nature has one of two values of, the one that is harder to see.
        found[p.hypothesis.label] = max(limit, found.get(p.hypothesis.label, limit))
    return found


def _closer_by(promise: Promise, robot: Robot, duration: float, below: bool) -> float | None:
    """
    Return at what size to look again, if any.

    Far below those that were looked at, parts may do what the effect does. Or it does nothing
    there: a limit that no command reaches.
    """
    size, (hidden, shown) = _limit(promise, robot, duration), _shown(promise)
    if hidden > 0.0 and size < shown:
        return math.sqrt(hidden * shown)
    far = below and not promise.hypothesis.effect.linear and size < FAR * shown
    return size if far else None


def _shown(promise: Promise) -> tuple[float, float]:
    """Return the largest size that changes nothing, 0 if none is known, and the least larger."""
    shows = promise.information > 0.0
    least = float(np.min(promise.magnitudes[shows], initial=np.inf))
    less = promise.magnitudes[promise.magnitudes < least]
    return float(np.max(less, initial=0.0)), least


def _size(promise: Promise) -> int:
    return int(np.argmax(promise.hypothesis.sizes))


def _limit(promise: Promise, robot: Robot, duration: float) -> float:
    """
    Return the size that is as large as what its own information makes detectable.

    Parts are taken as linear, which leaves of a large factor what a part undoes in full: of that
    a record knows no more than the part's tolerance does.
    """
    slab, k = promise.hypothesis.slab(duration), _size(promise)
    # A one-sided slab is twice as dense.
    price = -log_odds(promise.hypothesis.effect, robot) - np.log(2.0) * (slab.sided[k] != 0.0)
    known = promise.information > 0.0
    if not known.any():
        return float('inf')
    found = factors_on_parts(robot).get(promise.hypothesis.label)
    most = np.inf if found is None else found.part.tolerance**-2
    sizes = promise.magnitudes[known]
    information = np.minimum(promise.information[known], most)
    size = _turning(np.log(sizes), np.log(information), float(slab.width[k]), price)
    one = promise.hypothesis.parameters[k]
    return size if size <= max(one.high - one.null, one.null - one.low) else float('inf')


def _turning(sizes: Array, information: Array, width: float, price: float) -> float:
    """
    Return the least size that its own information makes detectable; logarithms are given.

    Halved between the looks on its two sides: information may rise with any power of the size, as
    of a limit that commands just reach, so that to go from size to size need not converge.
    """
    def needed(at: float) -> float:
        known = float(np.exp(np.interp(at, sizes, information)))
        return float(np.log(detectable(known, width, price)))

    shows = [k for k, at in enumerate(sizes) if needed(at) <= at]
    if not shows or shows[0] == 0:
        return float(np.exp(needed(sizes[0 if shows else -1])))
    low, high = sizes[shows[0] - 1:shows[0] + 1]
    for _ in range(ITERATIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if needed(middle) <= middle else (middle, high)
    return float(np.exp(high))
