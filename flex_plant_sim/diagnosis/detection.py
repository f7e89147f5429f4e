"""Detection limits: the smallest size of each effect that a record would have shown."""

from __future__ import annotations

from collections.abc import Sequence

from flex_plant_sim.arm_model import Array
from flex_plant_sim.diagnosis.fit import Fit, Projector
from flex_plant_sim.diagnosis.hypothesis import hypotheses, Hypothesis
from flex_plant_sim.diagnosis.problem import Problem
import numpy as np

SIGMAS = 4.5
UNSTABLE = 1e8


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
    k = int(np.argmax(hypothesis.sizes))
    unit, null = hypothesis.parameters[k].unit, hypothesis.parameters[k].null
    starts = hypothesis.starts(duration)
    away = np.abs(starts[:, k] - null)
    start = starts[np.argmin(np.where(away > 0.0, away, np.inf))]
    try:
        change = problem.residual([hypothesis.at(start)])[0] - problem.nominal
    except np.linalg.LinAlgError:
        return float('inf'), unit
    flat = projector.white(change)
    nuisance, _ = projector.nuisance(flat)
    left = change + problem.sensitivity @ nuisance
    practical = np.max(np.mean(left**2, axis=(0, 1)) / allowed)
    statistical = 2.0 * projector.cost(flat) / SIGMAS**2
    shown = min(practical, statistical)
    size = abs(start[k] - null)
    if not 1e-12 < shown < UNSTABLE:
        return float('inf'), unit
    return float(size / np.sqrt(shown)), unit
