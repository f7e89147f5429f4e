"""Sets of causes: what to fit and where to start, and the fits, around others and themselves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.events import Events, places_of_event
from flex_plant_sim.diagnosis.causes.fit import Descent, EXCESS, Fit, fitted, Point
from flex_plant_sim.diagnosis.causes.hypothesis import Causes, Hypothesis
from flex_plant_sim.diagnosis.causes.promise import Promise
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.prior import deviated
from flex_plant_sim.diagnosis.prediction.predictor import Base
from flex_plant_sim.diagnosis.record.data import Data
import numpy as np

# What a linearisation misstates by more than this, nats, where it says the best fit is, or values
# that are so unlikely where it was made, are linearised around again, up to so many times.
AGAIN, AROUND = 1.0, 6
# Parts further off than this, in tolerances, stand for a cause.
FAR = 3.0


@dataclass(frozen=True)
class Trial:
    """A set of causes to fit, and where to start: values (k,) each, deviations of the parts."""

    hypotheses: tuple[Hypothesis, ...]
    starts: tuple[Array, ...]
    deviations: Array | None = None

    @classmethod
    def of(cls, fit: Fit) -> Trial:
        """Return a fit as a trial."""
        return cls(fit.hypotheses, (fit.values,), fit.deviations)

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

    def with_each(self, promise: Promise) -> Iterator[Trial]:
        """Return the set with one cause more, and from each of its sizes: between are valleys."""
        yield self.with_one(promise)
        for start in promise.of_sizes:
            yield self.with_one(replace(promise, starts=(start,)))


@dataclass(frozen=True)
class Settled:
    """A set with the likelihood linearised around it, and its fit there."""

    likelihood: Likelihood
    point: Point
    fit: Fit
    # With the same values and the file's parts, where those were asked on the way.
    first: Likelihood | None = None

    @classmethod
    def at(cls, trial: Trial, base: Base, data: Data, scale: Array | None = None,
           jobs: int = 1, matters: Callable[[Fit, float], bool] = lambda fit, more: True
           ) -> Settled:
        """
        Return a set fitted around itself: around its values and its parts, Gauss-Newton in both.

        Each fit is judged by what the record leaves with its own values and parts, so that two of
        them compare wherever they were linearised; of several the best counts. What says when an
        event happened is integrated over, and where another time is likelier it is fitted there.

        Parameters
        ----------
        trial : Trial
            The set and where to start.
        base : Base
            What it is added to.
        data : Data
            The records.
        scale : Array, optional
            By how much errors exceed what is stated, (m,).
        jobs : int
            Processes.
        matters : Callable
            Told a fit and how many nats more the set may have, whether it is to be settled on.

        """
        found, gained = cls._around(trial, base, data, scale, jobs, matters)._over_time()
        if gained > AGAIN and matters(found.fit, gained):
            again, _ = cls._around(Trial.of(found.fit), base, data, scale, jobs,
                                   matters)._over_time()
            found = max(again, found, key=lambda s: s.fit.log_evidence)
        return found

    def extended(self, nominal: Base) -> Base:
        """Return the nominal base with the parts as re-estimated and the causes on."""
        parts, fit = self.likelihood.parts, self.fit
        kept = np.where([part.settles for part in parts], fit.deviations, 0.0)
        robot, sensors = deviated(nominal.robot, parts, kept)
        causes = Causes(fit.hypotheses, 1.0).effects(fit.values)
        return replace(nominal, robot=robot, effects=(*nominal.effects, *sensors, *causes))

    def _over_time(self) -> tuple[Settled, float]:
        """Return the set with its event at the likeliest time, and what that gains, nats."""
        descent = Descent(self.likelihood, self.causes, self.fit.scale)
        places = places_of_event(descent)
        if places is None or self.fit.moments.away[places.size] == 0.0:
            return self, 0.0
        point, fit, gained = Events(descent, self.point, places).integrated()
        return replace(self, point=point, fit=fit), gained

    @classmethod
    def _around(cls, trial: Trial, base: Base, data: Data, scale: Array | None, jobs: int,
                matters: Callable[[Fit, float], bool]) -> Settled:
        """
        Return a set fitted around itself, by the curvature there.

        What a linearisation promised and what is there tell how wrong it may be: a set that by so
        much more than was promised would still not matter is left there.
        """
        causes, starts = Causes(trial.hypotheses, data.duration), trial.starts
        known = np.ones(len(data.noise[0])) if scale is None else scale
        about, best, first = trial.deviations, None, None
        for _ in range(AROUND):
            likelihood = Likelihood(base, data.windows, data.noise, causes.effects(starts[0]),
                                    about, jobs)
            if about is None:
                first = likelihood
            descent = Descent(likelihood, causes, known)
            said = descent.run(starts) if best is None else descent.down(starts)
            told = descent.fit(said)
            point, about = _checked(descent, starts[0], said, told.deviations)
            found = cls(likelihood, point, descent.fit(point))
            rises = best is None or _apart(found.fit, best.fit) > 0.0
            if best is None or found.fit.log_evidence > best.fit.log_evidence:
                best = found
            way, k = point.values - starts[0], point.values.size
            gone = 0.5 * float(way @ np.linalg.solve(told.covariance[:k, :k], way))
            if not rises or (_apart(found.fit, told) == 0.0 and gone < AGAIN):
                break
            missed = told.log_evidence - found.fit.log_evidence
            if not matters(found.fit, max(missed, 0.0) + abs(missed)):
                break
            starts = (point.values,)
        assert best is not None
        return best if causes.hypotheses else replace(best, first=first)

    def near_file(self, base: Base, data: Data, jobs: int = 1) -> Settled:
        """
        Return no cause as sets of one are proposed and fitted from.

        Parts far off stand for a cause: with it they are near their file, and from where they are
        nothing tells so (one mode a link: 480 nats from the file, -54 from parts that are 7
        tolerances off). Then it is linearised around the file's parts.
        """
        if np.max(np.abs(self.fit.deviations / self.likelihood.tolerances)) <= FAR:
            return self
        likelihood = self.first or Likelihood(base, data.windows, data.noise, (), None, jobs)
        descent = Descent(likelihood, self.causes, self.fit.scale)
        point = descent.run((self.fit.values,))
        return Settled(likelihood, point, descent.fit(point))

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
        return Causes(self.fit.hypotheses, self.likelihood.duration)


def _apart(fit: Fit, other: Fit) -> float:
    """Return by how much one has more evidence, nats; 0 where that is not known."""
    more, unsure = fit.log_evidence - other.log_evidence, AGAIN
    if np.any(fit.scale > EXCESS):
        # Such errors are no white ones: their nats are known as far as windows agree.
        each = fit.by_window - other.by_window
        unsure = max(unsure, float(np.sqrt(each.size) * np.std(each)))
    return more if abs(more) > unsure else 0.0


def _checked(descent: Descent, start: Array, said: Point, about: Array) -> tuple[Point, Array]:
    """Return where a descent ends with its parts, exact there; the middle if that leaves less."""
    point = descent.checked(said, said.values, about)
    if point.cost > said.cost + AGAIN:
        halfway = 0.5 * (descent.likelihood.about + about)
        nearer = descent.checked(said, 0.5 * (start + said.values), halfway)
        if nearer.cost < point.cost:
            return nearer, halfway
    return point, about


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
