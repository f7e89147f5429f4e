"""What a model may miss without being called wrong: the yardstick of practical size."""

from __future__ import annotations

from collections.abc import Sequence

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.record.windows import Record
import numpy as np

MODEL_SHARE = 0.01
WRONG = 1.0


def model_error(records: Sequence[Record]) -> Array:
    """
    Return the mean squared error of a model that passes for correct, per channel, (m,).

    One percent of what the gauges see: two good models of the same arm (finite elements, a
    rigid-segment chain) differ by as much. Joints are integrators and get none.
    """
    strain = np.mean([np.var(record.output[:, 2:], axis=0) for record in records], axis=0)
    return np.concatenate([np.zeros(2), MODEL_SHARE**2 * strain])


def allowance(records: Sequence[Record], noise: Sequence[Array]) -> Array:
    """Return the squared prediction error that passes: noise and model error, (m,)."""
    return np.mean([level**2 for level in noise], axis=0) + model_error(records)


def misfit(residual: Array, noise: Sequence[Array], allowed: Array) -> Array:
    """Return how far the squared residual exceeds the noise, in allowances per channel, (m,)."""
    squared = np.mean(residual**2, axis=(0, 1))
    return (squared - np.mean([level**2 for level in noise], axis=0)) / allowed


def still_wrong(before: Array, after: Array) -> Array:
    """
    Return which channels miss more than an allowance and a hundredth of what was missed, (m,).

    A well-named cause is itself modelled to about one percent.
    """
    return np.asarray(after > WRONG + MODEL_SHARE * np.where(after < before, before, 0.0))
