"""Sets of causes: what to fit and where to start, and the fits, around others and themselves."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.fit import Causes, Descent, Fit, fitted, Point
from flex_plant_sim.diagnosis.causes.hypothesis import Hypothesis
from flex_plant_sim.diagnosis.causes.promise import Promise
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.prediction.predictor import Base
from flex_plant_sim.diagnosis.record.data import Data
import numpy as np

# A fit that gains more than this, nats, around where it came is fitted around that again.
AGAIN, AROUND = 1.0, 4
# So much of its width may a part that is far off be from where its differences reach.
NEAR = 0.03


@dataclass(frozen=True)
class Trial:
    """A set of causes to fit, and where to start, (k,) each."""

    hypotheses: tuple[Hypothesis, ...]
    starts: tuple[Array, ...]

    @classmethod
    def of(cls, fit: Fit) -> Trial:
        """Return a fit as a trial."""
        return cls(fit.hypotheses, (fit.values,))

    @property
    def labels(self) -> frozenset[str]:
        """Return the labels of the causes."""
        return frozenset(h.label for h in self.hypotheses)

    def without(self, place: int) -> Trial:
        """Return the set with one cause less."""
        pieces = Causes(self.hypotheses, 1.0).split(self.starts[0])
        rest = [piece for k, piece in enumerate(pieces) if k != place]
        return Trial(self.hypotheses[:place] + self.hypotheses[place + 1:],
                     (np.concatenate([np.zeros(0), *rest]),))

    def with_one(self, promise: Promise) -> Trial:
        """Return the set with one cause more."""
        return Trial((*self.hypotheses, promise.hypothesis),
                     tuple(np.concatenate([self.starts[0], start]) for start in promise.starts))


@dataclass(frozen=True)
class Settled:
    """A set with the likelihood linearised around it, and its fit there."""

    likelihood: Likelihood
    point: Point
    fit: Fit

    @classmethod
    def at(cls, trial: Trial, base: Base, data: Data, scale: Array | None = None) -> Settled:
        """Return a set fitted around itself, anew where that leads on."""
        causes, starts = Causes(trial.hypotheses, data.duration), trial.starts
        found: Settled | None = None
        known = np.ones(len(data.noise[0])) if scale is None else scale
        far = 0.0
        for _ in range(AROUND):
            likelihood = Likelihood(base, data.windows, data.noise, causes.effects(starts[0]),
                                    far)
            descent = Descent(likelihood, causes, known)
            point, before = descent.run(starts), found
            found = cls(likelihood, point, descent.fit(point))
            if base.discrepancy.far:
                # Differences that reach as far as the part does are right where it is.
                moved = far - found.fit.deviations[likelihood.far_part]
                if abs(moved) < NEAR * likelihood.tolerances[likelihood.far_part]:
                    break
                far, starts, before = far - moved, (point.values,), None
                continue
            if before is not None and found.fit.log_evidence < before.fit.log_evidence:
                return before
            if point.cost > descent.at(starts[0])[1] - AGAIN:
                break
            starts = (point.values,)
        assert found is not None
        return found

    @cached_property
    def from_afar(self) -> Settled:
        """Return the same set as each arm's own filter sees it, for what starts far off."""
        descent = Descent(self.likelihood.smooth, self.causes, self.fit.scale)
        values = self.fit.values
        point = descent.linearise(values, *descent.at(values))
        return Settled(self.likelihood.smooth, point, descent.fit(point))

    @cached_property
    def causes(self) -> Causes:
        """Return the causes that are on."""
        return Causes(self.fit.hypotheses, 1.0)


@dataclass(frozen=True)
class Fitter:
    """
    Fits sets around the linearisation of one near them.

    Where a set has coordinates that rest along the trajectory of that one, then once more along
    its own, the parts' columns being those of the one near it.
    """

    likelihood: Likelihood
    scale: Array
    duration: float
    rough: bool = False

    def __call__(self, trial: Trial) -> Fit:
        causes = Causes(trial.hypotheses, self.duration)
        near = fitted(self.likelihood, causes, trial.starts, self.scale, self.rough)
        effects = causes.effects(near.values)
        if self.rough or not self.likelihood.at_rest(effects):
            return near
        return fitted(self.likelihood.along(effects), causes, (near.values,), self.scale)
