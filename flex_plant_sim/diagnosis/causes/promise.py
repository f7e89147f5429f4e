"""What each hypothesis promises beside causes that are on: its linear evidence, and its starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.hypothesis import Hypothesis
from flex_plant_sim.diagnosis.causes.looks import Look, Looker
from flex_plant_sim.diagnosis.likelihood.evidence import Marginal
from flex_plant_sim.diagnosis.record.windows import Indices
import numpy as np

# Places that a fit may start from, the best first.
KEPT = 2


@dataclass(frozen=True)
class Promise:
    """
    What a hypothesis could add to the evidence.

    Attributes
    ----------
    hypothesis : Hypothesis
    gain : float
        Nats, by the best of its shapes, linearly or at a start itself.
    starts : tuple of Array
        Values to fit from, best first, (k,) each.
    of_sizes : tuple of Array
        Each size that was looked at, in its best shape, (k,) each: where a size is a frequency,
        nothing between two of them is linear.
    magnitudes, information : Array
        Deviations of the first size from null, (L,), and what the record knows of it there, one
        over its variance: what three of four shapes surpass, (L,).

    """

    hypothesis: Hypothesis
    gain: float
    starts: tuple[Array, ...]
    of_sizes: tuple[Array, ...]
    magnitudes: Array
    information: Array


@dataclass(frozen=True)
class Closer:
    """Looks at a hypothesis again at another size, beside the same causes."""

    looker: Looker
    beside: Beside

    def __call__(self, item: tuple[Promise, float]) -> Promise:
        """Return a promise that knows what the record holds of one more size."""
        promise, size = item
        first = int(np.argmax(promise.hypothesis.sizes))
        away = promise.hypothesis.magnitudes()[0]
        looks = self.looker.at(promise.hypothesis, away * size / abs(away[first]))
        if not looks:
            return promise
        more = self.beside.promise(promise.hypothesis, looks)
        sizes = np.concatenate([more.magnitudes, promise.magnitudes])
        order = np.argsort(sizes)
        return replace(promise, magnitudes=sizes[order], information=np.concatenate(
            [more.information, promise.information])[order])


@dataclass(frozen=True)
class _Place:
    """A place: its gain, its values, what it knows of each size, whether it was looked at."""

    gain: float
    values: Array
    information: Array
    looked: bool


class Beside:
    """
    Causes that are on: what every promise is measured against.

    Parameters
    ----------
    rows : Array
        Residual, columns of the causes, columns of the parts, weighted, (1 + k + p, m N).
    prior : Array
        Standard deviations of causes and parts, (k + p,).
    weight : Array
        Of each row's samples, (m N,).
    duration : float
        s.

    """

    def __init__(self, rows: Array, prior: Array, weight: Array, duration: float):
        self.rows, self.weight, self.duration = rows.astype(np.float32), weight, duration
        both = self.rows @ self.rows.T
        marginal = Marginal(both.astype(float), prior)
        self.explains = marginal.factor * prior
        self.taken = marginal.factor @ marginal.cross

    def promise(self, hypothesis: Hypothesis, looks: Sequence[Look]) -> Promise:
        """Return what a hypothesis promises."""
        groups: dict[tuple[float, ...], list[_Place]] = {}
        for look, products in zip(looks, self._products(looks)):
            groups.setdefault(tuple(look.away), []).extend(
                self._places(hypothesis, look, products))
        places = sorted((p for group in groups.values() for p in group), key=lambda p: -p.gain)
        first = int(np.argmax(hypothesis.sizes))
        return Promise(
            hypothesis, places[0].gain, tuple(p.values for p in places[:KEPT]),
            tuple(max(some, key=lambda p: p.gain).values for group in groups.values()
                  if (some := [p for p in group if p.looked])),
            np.array([abs(away[first]) for away in groups]),
            np.array([np.quantile([p.information[first] for p in group], 0.25)
                      for group in groups.values()]))

    def _products(self, looks: Sequence[Look]) -> list[tuple[Array, Array]]:
        """Return each look's Hessian (s, s) and gradient (s,), the others integrated out."""
        changes = np.stack([look.changes for look in looks]) * self.weight
        with_rows = (changes @ self.rows.T).astype(float)
        own = np.matmul(changes, changes.transpose(0, 2, 1)).astype(float)
        seen = with_rows[..., 1:] @ self.explains.T
        gradient = with_rows[..., 0] - seen @ self.taken
        return list(zip(own - seen @ seen.transpose(0, 2, 1), gradient))

    def _places(self, hypothesis: Hypothesis, look: Look, products: tuple[Array, Array]
                ) -> list[_Place]:
        """Return the linear optimum of the sizes of a shape, and the sizes looked at."""
        sizes, shape = np.flatnonzero(hypothesis.sizes), look.shape
        away, slab = look.away[sizes], hypothesis.slab(self.duration)
        width, likely = slab.width[sizes], (slab.centre - shape)[sizes]
        hessian = products[0] / away[:, None] / away
        gradient = products[1] / away
        total = hessian + np.diag(width**-2.0)
        best = np.clip(np.linalg.solve(total, likely / width**2 - gradient),
                       (hypothesis.low - shape)[sizes], (hypothesis.high - shape)[sizes])
        occam = 0.5 * float(np.linalg.slogdet(width[:, None] * total * width)[1])
        information = np.zeros(shape.size)
        information[sizes] = np.diagonal(hessian)

        def gain(change: Array) -> float:
            unlikely = (change - likely) / width
            return -float(gradient @ change + 0.5 * change @ hessian @ change
                          + 0.5 * unlikely @ unlikely) - occam

        found = [_Place(gain(best), _moved(shape, sizes, best), information, False)]
        if sizes.size == 1:
            found.append(_Place(gain(away), _moved(shape, sizes, away), information, True))
        return found


def _moved(shape: Array, sizes: Indices, change: Array) -> Array:
    values = shape.copy()
    values[sizes] += change
    return values
