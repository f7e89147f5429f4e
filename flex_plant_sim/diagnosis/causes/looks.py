"""One look at every hypothesis: what each size and shape of it would change in a record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.hypothesis import Hypothesis
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
import numpy as np

# Arms that run at once: memory goes with them.
BATCH = 8


@dataclass(frozen=True)
class Look:
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
    away: Array
    changes: Array


@dataclass(frozen=True)
class Looker:
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

    def __call__(self, hypothesis: Hypothesis) -> tuple[Hypothesis, tuple[Look, ...]]:
        """
        Return a hypothesis with its looks.

        Raises
        ------
        LinAlgError
            Where none makes a finite prediction.

        """
        found = [look for away in _amounts(hypothesis)
                 for look in self.at(hypothesis, away)]
        if not found:
            raise np.linalg.LinAlgError(f'{hypothesis.label}: no finite prediction')
        return hypothesis, tuple(found)

    def at(self, hypothesis: Hypothesis, away: Array) -> list[Look]:
        """Return a look at each shape with sizes `away` from null, (k,), one at a time."""
        sizes, event = np.flatnonzero(hypothesis.sizes), hypothesis.event
        shapes = hypothesis.shapes(self.duration)
        asked = shapes if event is None else _first(shapes, event)
        values = np.repeat(asked, sizes.size, axis=0)
        index = np.tile(sizes, len(asked))
        values[np.arange(len(values)), index] += away[index]
        white = self._changes(hypothesis, values).reshape(len(asked), sizes.size, -1)
        if event is not None:
            asked, white = self._later(shapes, asked, event, white)
        return [Look(shape, away, rows) for shape, rows in zip(asked, white)
                if np.all(np.isfinite(rows))]

    def _changes(self, hypothesis: Hypothesis, values: Array) -> Array:
        """Return what values (B, k) add to the residual, (B, m, N)."""
        batches = list(values) if hypothesis.effect.structural else [
            values[k:k + BATCH] for k in range(0, len(values), BATCH)]
        around = self.likelihood.around
        return np.concatenate([
            (self.likelihood.residual((*around, hypothesis.at(v)))
             - self.likelihood.present).astype(np.float32) for v in batches])

    def _later(self, shapes: Array, asked: Array, event: int, white: Array
               ) -> tuple[Array, Array]:
        """
        Return looks at an event of all times, from one at the start of the record.

        What has not happened yet changes nothing, and what happened earlier is forgotten by the
        filter within a period.
        """
        times = self.likelihood.times
        rows = white.reshape(*white.shape[:2], -1, times.size)
        origin = [int(np.argmin(np.sum((np.delete(asked, event, 1) - rest)**2, axis=1)))
                  for rest in np.delete(shapes, event, 1)]
        late = times >= shapes[:, event, None]
        found = rows[origin] * late[:, None, None]
        return shapes, found.reshape(len(shapes), white.shape[1], -1)


def _first(shapes: Array, event: int) -> Array:
    """Return the shapes (S, k) that differ in more than the event's time, at the start."""
    moved = shapes.copy()
    moved[:, event] = 0.0
    return np.unique(moved, axis=0)


def _amounts(hypothesis: Hypothesis) -> Sequence[Array]:
    """Return deviations to look at; one is enough where all is proportional to it."""
    some = hypothesis.magnitudes()
    return some[:1] if hypothesis.effect.linear else some
