"""
Sensitivities: what each hypothesis changes in the residual, at each of its shapes and sizes.

They are taken once in a search, under the model without causes. Proposals are computed from them
beside any set of causes, without further passes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.hypothesis import BATCH_SIZE, Hypothesis
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
import numpy as np


@dataclass(frozen=True)
class Sensitivity:
    """
    Finite changes of the residual by a hypothesis at one shape.

    Attributes
    ----------
    shape : Array
        Values with all sizes at null, (k,).
    deviation : Array
        Deviations of the sizes from null at which it was taken, zero for shapes, (k,).
    changes : Array
        Of the residual, by each of the s sizes alone, (s, m N), single precision.

    """

    shape: Array
    deviation: Array
    changes: Array


@dataclass(frozen=True)
class SensitivityProbe:
    """
    Takes sensitivities under one likelihood, that of the model without causes.

    What an effect changes depends little on which others are present, so these serve the whole
    search: they make proposals, fits decide.

    Attributes
    ----------
    likelihood : Likelihood
    duration : float
        Of the longest record, s.

    """

    likelihood: Likelihood
    duration: float

    def __call__(self, hypothesis: Hypothesis) -> tuple[Hypothesis, tuple[Sensitivity, ...]]:
        """
        Return a hypothesis with its sensitivities at all probe deviations and shapes.

        Raises
        ------
        LinAlgError
            Where no prediction is finite.

        """
        found = [sensitivity for deviation in _needed_deviations(hypothesis)
                 for sensitivity in self.sensitivities(hypothesis, deviation)]
        if not found:
            raise np.linalg.LinAlgError(f'{hypothesis.label}: no finite prediction')
        return hypothesis, tuple(found)

    def sensitivities(self, hypothesis: Hypothesis, deviation: Array) -> list[Sensitivity]:
        """Return the finite sensitivities at each shape, sizes deviating from null by (k,)."""
        sizes, event_index = np.flatnonzero(hypothesis.is_size), hypothesis.event_index
        shapes = hypothesis.shape_grid(self.duration)
        probed = shapes if event_index is None else _at_start(shapes, event_index)
        values = np.repeat(probed, sizes.size, axis=0)
        index = np.tile(sizes, len(probed))
        values[np.arange(len(values)), index] += deviation[index]
        changes = self._changes(hypothesis, values).reshape(len(probed), sizes.size, -1)
        if event_index is not None:
            probed, changes = self._at_all_times(shapes, probed, event_index, changes)
        return [Sensitivity(shape, deviation, rows) for shape, rows in zip(probed, changes)
                if np.all(np.isfinite(rows))]

    def _changes(self, hypothesis: Hypothesis, values: Array) -> Array:
        """Return the changes of the residual by values (B, k), (B, m, N)."""
        batches = list(values) if hypothesis.effect.structural else [
            values[k:k + BATCH_SIZE] for k in range(0, len(values), BATCH_SIZE)]
        centre_effects = self.likelihood.centre_effects
        return np.concatenate([
            (self.likelihood.residual((*centre_effects, hypothesis.effect_at(v)))
             - self.likelihood.centre_residual).astype(np.float32) for v in batches])

    def _at_all_times(self, shapes: Array, probed: Array, event_index: int, changes: Array
                      ) -> tuple[Array, Array]:
        """
        Return shapes and changes for an event at all times, from one at the start of the record.

        Before the event nothing changes; the filter forgets what came before it within a period.
        """
        times = self.likelihood.times
        rows = changes.reshape(*changes.shape[:2], -1, times.size)
        origin = [int(np.argmin(np.sum((np.delete(probed, event_index, 1) - rest)**2, axis=1)))
                  for rest in np.delete(shapes, event_index, 1)]
        happened = times >= shapes[:, event_index, None]
        found = rows[origin] * happened[:, None, None]
        return shapes, found.reshape(len(shapes), changes.shape[1], -1)


def _at_start(shapes: Array, event_index: int) -> Array:
    """Return shapes (S, k) with the event at the start, those that differ otherwise."""
    moved = shapes.copy()
    moved[:, event_index] = 0.0
    return np.unique(moved, axis=0)


def _needed_deviations(hypothesis: Hypothesis) -> Sequence[Array]:
    """Return the deviations to probe; one is enough for a linear effect."""
    deviations = hypothesis.probe_deviations()
    return deviations[:1] if hypothesis.effect.linear else deviations
