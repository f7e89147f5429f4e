"""Detection limits: the size of each effect at which a record's evidence turns."""

from __future__ import annotations

from collections.abc import Sequence

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.diagnosis.causes.pool import each
from flex_plant_sim.diagnosis.causes.promise import Closer, Promise
from flex_plant_sim.diagnosis.likelihood.evidence import detectable
from flex_plant_sim.diagnosis.likelihood.prior import log_odds
import numpy as np

ITERATIONS = 20
# Looks nearer by, and what is far: information is interpolated between sizes.
CLOSER, FAR = 2, 0.7


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
    for _ in range(CLOSER):
        items = [(p, _limit(p, robot, duration)) for p in promises]
        far = [(p, size) for p, size in items if _below(p, size)]
        again = {p.hypothesis: p for p in each(closer, far, jobs)}
        promises = [again.get(p.hypothesis, p) for p in promises]
    found: dict[str, tuple[float, str]] = {}
    for p in promises:
        limit = (_limit(p, robot, duration), p.hypothesis.parameters[_size(p)].unit)
        found[p.hypothesis.label] = min(limit, found.get(p.hypothesis.label, limit))
    return found


def _below(promise: Promise, size: float) -> bool:
    """Tell whether a size is far below all that were looked at, where that may matter."""
    linear = promise.hypothesis.effect.linear
    return not linear and bool(size < FAR * np.min(promise.magnitudes))


def _size(promise: Promise) -> int:
    return int(np.argmax(promise.hypothesis.sizes))


def _limit(promise: Promise, robot: Robot, duration: float) -> float:
    """Return the size that is as large as what its own information makes detectable."""
    slab, k = promise.hypothesis.slab(duration), _size(promise)
    # A one-sided slab is twice as dense.
    price = -log_odds(promise.hypothesis.effect, robot) - np.log(2.0) * (slab.sided[k] != 0.0)
    known = promise.information > 0.0
    if not known.any():
        return float('inf')
    where, what = np.log(promise.magnitudes[known]), np.log(promise.information[known])
    size = float(promise.magnitudes[known][0])
    for _ in range(ITERATIONS):
        information = float(np.exp(np.interp(np.log(size), where, what)))
        size = float(np.sqrt(size * detectable(information, float(slab.width[k]), price)))
        if not np.isfinite(size):
            return size
    low, high = promise.hypothesis.bounds[k]
    null = promise.hypothesis.parameters[k].null
    return size if size <= max(high - null, null - low) else float('inf')
