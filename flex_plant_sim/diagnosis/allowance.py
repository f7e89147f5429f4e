"""What a model may miss without being called wrong: the yardstick of practical size."""

from __future__ import annotations

from collections.abc import Sequence

from flex_plant_sim.arm_model import Array
from flex_plant_sim.diagnosis.windows import Record
import numpy as np

MODEL_SHARE = 0.01


def allowance(records: Sequence[Record], noise: Sequence[Array]) -> Array:
    """
    Return the mean squared prediction error that passes for correct, per channel, (m,).

    The sensors' noise, and for strain one percent of what the gauges see: two good models of
    the same arm (finite elements, a rigid-segment chain) differ by as much.
    """
    strain = np.mean([np.var(record.output[:, 2:], axis=0) for record in records], axis=0)
    allowed = np.mean([level**2 for level in noise], axis=0)
    allowed[2:] += MODEL_SHARE**2 * strain
    return allowed


def misfit(residual: Array, noise: Sequence[Array], allowed: Array) -> Array:
    """Return how far the squared residual exceeds the noise, in allowances per channel, (m,)."""
    squared = np.mean(residual**2, axis=(0, 1))
    return (squared - np.mean([level**2 for level in noise], axis=0)) / allowed
