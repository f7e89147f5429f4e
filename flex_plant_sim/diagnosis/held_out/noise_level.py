"""How much process noise a record asks for, under a given model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.held_out.nuisance import settled_base
from flex_plant_sim.diagnosis.prediction.predictor import Base, Predictor
from flex_plant_sim.diagnosis.record.windows import Windows
import numpy as np

FACTOR = 10.0**0.5
RISES = 2
LEAST_GAIN = 0.01

Level = tuple[float, float]


def likeliest_level(base: Base, windows: Sequence[Windows], noise: Sequence[Array]) -> Level:
    """
    Return the level at or above the base's that makes the record likeliest.

    A model that is far off needs a predictor that trusts its sensors more: with too little
    process noise one-step prediction turns into simulation, and drift names the causes. The
    covariance of the innovations is the record's own (concentrated likelihood); levels rise in
    half decades, for the joints and for the deflections, while that gains anything, up to a
    decade: a predictor that trusts its sensors wholly tells nothing.
    """
    level, best = base.level, _log_likelihood(base, base.level, windows, noise)
    while True:
        raised = [(level[0] * a, level[1] * b) for a, b in (
            (FACTOR, 1.0), (1.0, FACTOR), (FACTOR, FACTOR))]
        allowed = [trial for trial in raised if all(
            new < old * FACTOR**(RISES + 0.5) for new, old in zip(trial, base.level))]
        found = [_log_likelihood(base, trial, windows, noise) for trial in allowed]
        if not found or max(found) < best + LEAST_GAIN:
            return level
        best, level = max(found), allowed[int(np.argmax(found))]


def _log_likelihood(base: Base, level: Level, windows: Sequence[Windows],
                    noise: Sequence[Array]) -> float:
    """Return the log-likelihood per sample, less a constant, nats."""
    model = settled_base(replace(base, level=level), windows[0].record.payload)
    errors = np.concatenate([Predictor(model, w, s).innovations().reshape(-1, s.size)
                             for w, s in zip(windows, noise)])
    sign, size = np.linalg.slogdet(errors.T @ errors / len(errors))
    return -0.5 * float(size) if sign > 0 and np.isfinite(size) else -np.inf
