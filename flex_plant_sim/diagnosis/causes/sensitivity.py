"""One look at every hypothesis: what each size and shape of it would change in a record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.hypothesis import Hypothesis
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
import numpy as np

# Arms that run at once: memory goes with them.
BATCH_SIZE = 8


@dataclass(frozen=True)
class Sensitivity:
    """
    Changes of the residual by a hypothesis at one shape.

    Attributes
    ----------
    shape : Array
        Values with the sizes at null, (k,).
    away : Array
        Deviations from null at which it was looked, (k,); zero for what is no size.
    changes : Array
        By each size alone, (s, m N), single precision.

    """

    shape: Array
    deviation: Array
    changes: Array


@dataclass(frozen=True)
class SensitivityProbe:
    """
    Looks at hypotheses through one likelihood, that of the nominal model.

    What one adds is nearly the same whatever else is on, so one look serves the whole search: it
    proposes, and fits decide.

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
        Return a hypothesis with its looks.

        Raises
        ------
        LinAlgError
            Where none makes a finite prediction.

        """
        found = [look for deviation in _probe_deviations(hypothesis)
                 for look in self.sensitivities(hypothesis, deviation)]
        if not found:
            raise np.linalg.LinAlgError(f'{hypothesis.label}: no finite prediction')
        return hypothesis, tuple(found)

    def sensitivities(self, hypothesis: Hypothesis, deviation: Array) -> list[Sensitivity]:
        """Return a look at each shape with sizes `away` from null, (k,), one at a time."""
        is_size, event_index = np.flatnonzero(hypothesis.is_size), hypothesis.event_index
        shape_grid = hypothesis.shape_grid(self.duration)
        probed = shape_grid if event_index is None else _at_start(shape_grid, event_index)
        values = np.repeat(probed, is_size.size, axis=0)
        index = np.tile(is_size, len(probed))
        values[np.arange(len(values)), index] += deviation[index]
        changes = self._changes(hypothesis, values).reshape(len(probed), is_size.size, -1)
        if event_index is not None:
            probed, changes = self._at_all_times(shape_grid, probed, event_index, changes)
        return [Sensitivity(shape, deviation, rows) for shape, rows in zip(probed, changes)
                if np.all(np.isfinite(rows))]

    def _changes(self, hypothesis: Hypothesis, values: Array) -> Array:
        """Return what values (B, k) add to the residual, (B, m, N)."""
        batches = list(values) if hypothesis.effect.structural else [
            values[k:k + BATCH_SIZE] for k in range(0, len(values), BATCH_SIZE)]
        centre_effects = self.likelihood.centre_effects
        return np.concatenate([
            (self.likelihood.residual((*centre_effects, hypothesis.effect_at(v)))
             - self.likelihood.centre_residual).astype(np.float32) for v in batches])

    def _at_all_times(self, shape_grid: Array, probed: Array, event_index: int, changes: Array
               ) -> tuple[Array, Array]:
        """
        Return looks at an event of all times, from one at the start of the record.

        What has not happened yet changes nothing, and what happened earlier is forgotten by the
        filter within a period.
        """
        times = self.likelihood.times
        rows = changes.reshape(*changes.shape[:2], -1, times.size)
        origin = [int(np.argmin(np.sum((np.delete(probed, event_index, 1) - rest)**2, axis=1)))
                  for rest in np.delete(shape_grid, event_index, 1)]
        late = times >= shape_grid[:, event_index, None]
        found = rows[origin] * late[:, None, None]
        return shape_grid, found.reshape(len(shape_grid), changes.shape[1], -1)


def _at_start(shape_grid: Array, event_index: int) -> Array:
    """Return the shapes (S, k) that differ in more than the event's time, at the start."""
    moved = shape_grid.copy()
    moved[:, event_index] = 0.0
    return np.unique(moved, axis=0)


def _probe_deviations(hypothesis: Hypothesis) -> Sequence[Array]:
    """Return deviations to look at; one is enough where all is proportional to it."""
    some = hypothesis.probe_deviations()
    return some[:1] if hypothesis.effect.linear else some
