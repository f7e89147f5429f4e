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

# Times of an event that are looked at in each period of the slowest mode, and in its duration: so
# many that a start is within reach of the nearest maximum.
TIMES_A_PERIOD = 10


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

    """

    likelihood: Likelihood

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

    def sensitivities(self, hypothesis: Hypothesis, deviation: Array, first_size: bool = False
                      ) -> list[Sensitivity]:
        """
        Return the finite sensitivities at each shape, sizes deviating from null by (k,).

        On request, by the first size alone.
        """
        sizes, is_event = np.flatnonzero(hypothesis.is_size), hypothesis.event_index is not None
        sizes = sizes[:1] if first_size else sizes
        shapes = self._event_shapes(hypothesis) if is_event else hypothesis.shape_grid
        probed = hypothesis.null[None] if is_event else shapes
        values = np.repeat(probed, sizes.size, axis=0)
        index = np.tile(sizes, len(probed))
        values[np.arange(len(values)), index] += deviation[index]
        changes = self._changes(hypothesis, values).reshape(len(probed), sizes.size, -1)
        if is_event:
            changes = self._at_all_times(hypothesis, shapes, changes[0])
        return [Sensitivity(shape, deviation, rows) for shape, rows in zip(shapes, changes)
                if np.all(np.isfinite(rows))]

    def _changes(self, hypothesis: Hypothesis, values: Array) -> Array:
        """Return the changes of the residual by values (B, k), (B, m, N)."""
        batches = list(values) if hypothesis.effect.structural else [
            values[k:k + BATCH_SIZE] for k in range(0, len(values), BATCH_SIZE)]
        centre_effects = self.likelihood.centre_effects
        return np.concatenate([
            (self.likelihood.residual((*centre_effects, hypothesis.effect_at(v)))
             - self.likelihood.centre_residual).astype(np.float32) for v in batches])

    def _event_shapes(self, hypothesis: Hypothesis) -> Array:
        """
        Return shapes of events at times at which samples tell them apart, (S, k).

        Over the time of a sudden event the evidence has several maxima within a period of the arm.
        """
        samples, found = np.unique(self.likelihood.times), []
        for shape in hypothesis.shape_grid:
            step = max(self.likelihood.period, hypothesis.event_duration(shape)) / TIMES_A_PERIOD
            _, first = np.unique(np.floor(samples / step), return_index=True)
            found.append(np.repeat(shape[None], first.size, axis=0))
            found[-1][:, hypothesis.event_index] = samples[first]
        return np.concatenate(found)

    def _at_all_times(self, hypothesis: Hypothesis, shapes: Array, changes: Array) -> Array:
        """
        Return the changes by events of all shapes, from those of one before the record (s, m N).

        Before an event nothing changes; the filter forgets what came before it within a period.
        What a gradual one changes is the mean of what sudden ones do over its duration.
        """
        happened = np.stack([hypothesis.event_share(self.likelihood.times, s) for s in shapes])
        rows = changes.reshape(len(changes), -1, self.likelihood.times.size)
        found = rows * happened[:, None, None].astype(np.float32)
        return found.reshape(len(shapes), len(changes), -1)


def _needed_deviations(hypothesis: Hypothesis) -> Sequence[Array]:
    """Return the deviations to probe; one is enough for a linear effect."""
    deviations = hypothesis.probe_deviations()
    return deviations[:1] if hypothesis.effect.linear else deviations
