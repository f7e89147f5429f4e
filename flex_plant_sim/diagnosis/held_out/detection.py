"""Detection limits: the smallest size of each effect that a record would have shown."""

from __future__ import annotations

from collections.abc import Sequence

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.held_out.fit import Fit, Projector
from flex_plant_sim.diagnosis.held_out.hypothesis import hypotheses, Hypothesis
from flex_plant_sim.diagnosis.held_out.problem import Problem
from flex_plant_sim.effects.base import Effect
import numpy as np

SIGMAS = 4.5
SHAPES, MOST_SHAPES = 0.75, 4
SECANTS, CLOSE, SMALLEST_SHARE = 5, 0.3, 0.01


def detection_limits(problem: Problem, base: Fit, allowed: Array, duration: float,
                     exclude: Sequence[str] = ()) -> dict[str, tuple[float, str]]:
    """
    Return 'identifier:site' to (smallest deviation from null, unit); inf where none shows.

    A size counts as shown when what it does to the predictions, less what the base parameters
    could undo, exceeds the allowance in some channel and 4.5 standard errors overall.
    """
    projector = Projector(problem, base.weighting)
    limits = {}
    for hypothesis in hypotheses(problem.base.robot, exclude):
        limits[hypothesis.label] = _limit(problem, projector, hypothesis, allowed, duration)
    return limits


def _limit(problem: Problem, projector: Projector, hypothesis: Hypothesis, allowed: Array,
           duration: float) -> tuple[float, str]:
    """Return the limit that three of four of its shapes (a time, a source) stay below."""
    k = int(np.argmax(hypothesis.sizes))
    shapes = _shapes(hypothesis, duration)
    some = np.unique(np.linspace(0, len(shapes) - 1, MOST_SHAPES).round().astype(int))
    sizes = [_smallest(problem, projector, hypothesis, start, allowed) for start in shapes[some]]
    return float(np.quantile(sizes, SHAPES, method='lower')), hypothesis.parameters[k].unit


def _shapes(hypothesis: Hypothesis, duration: float) -> Array:
    """Return the smallest start of every shape and sign, (S, k)."""
    found: dict[tuple[float, ...], Array] = {}
    starts = hypothesis.starts(duration)
    nearest = np.argsort(np.linalg.norm((starts - hypothesis.null)[:, hypothesis.sizes], axis=1),
                         kind='stable')
    for start in starts[nearest]:
        away = np.sign((start - hypothesis.null)[hypothesis.sizes])
        if away.any():
            found.setdefault((*away, *start[np.logical_not(hypothesis.sizes)]), start)
    return np.array(list(found.values()))


def _smallest(problem: Problem, projector: Projector, hypothesis: Hypothesis, start: Array,
              allowed: Array) -> float:
    """
    Return the smallest size of a start's shape (k,) that shows; inf if none within bounds does.

    Base parameters undo small sizes and run out of tolerance at larger ones, so one start does
    not tell by proportion: secants within a bracket.
    """
    k, away = int(np.argmax(hypothesis.sizes)), start - hypothesis.null
    sizes = hypothesis.sizes & (away != 0.0)
    bound = np.where(away > 0.0, hypothesis.high, hypothesis.low)
    reach = float(np.min((bound - hypothesis.null)[sizes] / away[sizes]))
    hidden, shown, share = 0.0, np.inf, 1.0
    for _ in range(SECANTS):
        values = np.where(sizes, hypothesis.null + share * away, start)
        factor = _factor(problem, projector, hypothesis.at(values), allowed)
        if abs(np.log(factor)) < CLOSE:
            break
        hidden, shown = (share, shown) if factor > 1.0 else (hidden, share)
        if hidden >= reach:
            return np.inf
        share *= factor
        if not hidden < share < shown:
            share = np.sqrt(max(hidden, SMALLEST_SHARE * shown) * shown)
        share = min(share, reach)
    return float(share * abs(away[k]))


def _factor(problem: Problem, projector: Projector, effect: Effect, allowed: Array) -> float:
    """Return the multiple of an effect that would just show were all linear; inf if none."""
    try:
        change = problem.residual([effect])[0] - problem.nominal
    except np.linalg.LinAlgError:
        return float('inf')
    flat = projector.white(change)
    nuisance, _ = projector.nuisance(flat)
    left = change + problem.sensitivity @ nuisance
    practical = np.max(np.mean(left**2, axis=(0, 1)) / allowed)
    statistical = 2.0 * projector.cost(flat) / SIGMAS**2
    shown = min(practical, statistical)
    return float(1.0 / np.sqrt(shown)) if 1e-12 < shown < np.inf else float('inf')
