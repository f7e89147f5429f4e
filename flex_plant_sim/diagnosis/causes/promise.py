"""What each hypothesis promises beside causes that are on: its linear evidence, and its starts."""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.fit import Causes, Fit, joined_marginal
from flex_plant_sim.diagnosis.causes.hypothesis import Hypothesis
from flex_plant_sim.diagnosis.likelihood.evidence import Marginal
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.record.windows import Indices
import numpy as np

BATCH = 8
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
    magnitudes, information : Array
        Deviations of the first size from null, (L,), and what the record knows of it there, one
        over its variance: what three of four shapes surpass, (L,).

    """

    hypothesis: Hypothesis
    gain: float
    starts: tuple[Array, ...]
    magnitudes: Array
    information: Array


@dataclass(frozen=True)
class _Look:
    """One place to look at: where it is, what it gains, what it knows of each size."""

    gain: float
    values: Array
    information: Array


class Context:
    """
    Causes that are on, with their linearisation: what every promise is measured against.

    Parameters
    ----------
    likelihood : Likelihood
        Around the causes.
    fit : Fit
        Of the causes.
    duration : float
        s.

    """

    def __init__(self, likelihood: Likelihood, fit: Fit, duration: float):
        self.likelihood, self.duration = likelihood, duration
        self.on = Causes(fit.hypotheses, duration).effects(fit.values)
        self.marginal: Marginal = likelihood.parts_marginal
        self.residual = likelihood.undeviated(likelihood.present)
        if fit.hypotheses:
            self.marginal, self.residual = joined_marginal(
                likelihood, Causes(fit.hypotheses, duration), fit.values)
        self.quadratic = self.marginal.quadratic(self.residual)

    def changes(self, hypothesis: Hypothesis, values: Array) -> Array:
        """Return what values (B, k) add to the residual, (B, M)."""
        batches = list(values) if hypothesis.effect.structural else [
            values[k:k + BATCH] for k in range(0, len(values), BATCH)]
        found = [self.likelihood.residual((*self.on, hypothesis.at(v))) for v in batches]
        return np.concatenate(found) - self.likelihood.present

    def __call__(self, hypothesis: Hypothesis) -> Promise:
        """Return what a hypothesis promises."""
        magnitudes = hypothesis.magnitudes()
        groups = [self._looks(hypothesis, away) for away in magnitudes]
        looks = sorted((look for group in groups for look in group), key=lambda x: -x.gain)
        if not looks:
            raise np.linalg.LinAlgError(f'{hypothesis.label}: no finite prediction')
        first, some = int(np.argmax(hypothesis.sizes)), [k for k, g in enumerate(groups) if g]
        return Promise(
            hypothesis, looks[0].gain, tuple(x.values for x in looks[:KEPT]),
            np.array([abs(magnitudes[k][first]) for k in some]),
            np.array([np.quantile([x.information[first] for x in groups[k]], 0.25)
                      for k in some]))

    def _looks(self, hypothesis: Hypothesis, away: Array) -> list[_Look]:
        """Return a look at each shape with sizes `away` from null, (k,), one at a time."""
        sizes = np.flatnonzero(hypothesis.sizes)
        shapes = hypothesis.shapes(self.duration)
        values = np.repeat(shapes, sizes.size, axis=0)
        index = np.tile(sizes, len(shapes))
        values[np.arange(len(values)), index] += away[index]
        white = self.changes(hypothesis, values)
        found = []
        for k, shape in enumerate(shapes):
            rows = slice(k * sizes.size, (k + 1) * sizes.size)
            if np.all(np.isfinite(white[rows])):
                found += self._best(hypothesis, shape, away, white[rows])
        return found

    def _best(self, hypothesis: Hypothesis, shape: Array, away: Array, white: Array
              ) -> list[_Look]:
        """Return the linear optimum of the sizes of a shape, and the sizes looked at."""
        sizes = np.flatnonzero(hypothesis.sizes)
        width = hypothesis.slab(self.duration).width[sizes]
        rows = white / away[sizes][:, None]
        hessian = self.marginal.inner(rows, rows)
        gradient = self.marginal.inner(rows, self.residual[None])[:, 0]
        total = hessian + np.diag(width**-2.0)
        best = -np.linalg.solve(total, gradient)
        best = np.clip(best, (hypothesis.low - shape)[sizes], (hypothesis.high - shape)[sizes])
        occam = 0.5 * np.linalg.slogdet(width[:, None] * total * width)[1]
        gain = -float(gradient @ best + 0.5 * best @ total @ best) - occam
        information = np.zeros(shape.size)
        information[sizes] = np.diagonal(hessian)
        found = [_Look(gain, self._moved(shape, sizes, best), information)]
        if sizes.size == 1:
            own = self.quadratic - self.marginal.quadratic(self.residual + white[0])
            exact = 0.5 * own - 0.5 * float(
                (away[sizes][0] / width[0])**2) - occam
            found.append(_Look(exact, self._moved(shape, sizes, away[sizes]), information))
        return found

    @staticmethod
    def _moved(shape: Array, sizes: Indices, change: Array) -> Array:
        values = shape.copy()
        values[sizes] += change
        return values
