"""The search for sets of causes: add, exchange, drop until the evidence stops rising."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.fit import Causes, Descent, Fit, fitted, Point
from flex_plant_sim.diagnosis.causes.hypothesis import hypotheses, Hypothesis
from flex_plant_sim.diagnosis.causes.looks import Look, Looker
from flex_plant_sim.diagnosis.causes.pool import attempt, each
from flex_plant_sim.diagnosis.causes.posterior import Key, log_prior, Posterior
from flex_plant_sim.diagnosis.causes.promise import Beside, Promise
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.moments import TEMPER
from flex_plant_sim.diagnosis.likelihood.prior import log_odds
from flex_plant_sim.diagnosis.prediction.discrepancy import Amplitude
from flex_plant_sim.diagnosis.prediction.predictor import Base
from flex_plant_sim.diagnosis.record.data import Data
import numpy as np

Level = Amplitude
Progress = Callable[[str, float], None]

# What `unknown` is: slow torques, gauge errors or both of 20 % of the loads and the strains.
UNKNOWN_LEVELS: tuple[Level, ...] = (
    Amplitude(torque=0.2, gauge=0.2), Amplitude(torque=0.2), Amplitude(gauge=0.2))
# A budget, no judgement: sets whose neighbours are fitted, sets linearised around themselves,
# hypotheses fitted beside a set, rivals tried in each one's place, samples that looks are made of.
EXPLORED, SETTLED, FITTED, RIVALS, SAMPLES = 5, 12, 6, 3, 1600
# What promises less than this, nats with its price, or so much less than another, has no share
# that is worth stating; nor has a set that is less probable.
WORTH, BEHIND, SHARE = -5.0, 20.0, 0.05
# Errors that exceed what is stated by less leave nothing for a larger discrepancy to explain.
EXCESS = 1.05


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
        """Return a set fitted around itself."""
        causes = Causes(trial.hypotheses, data.duration)
        likelihood = Likelihood(base, data.windows, data.noise, causes.effects(trial.starts[0]))
        descent = Descent(likelihood, causes, np.ones(len(data.noise[0])) if scale is None
                          else scale)
        point = descent.run(trial.starts)
        return cls(likelihood, point, descent.fit(point))

    @cached_property
    def causes(self) -> Causes:
        """Return the causes that are on."""
        return Causes(self.fit.hypotheses, 1.0)


@dataclass(frozen=True)
class Search:
    """
    Where a search ended.

    Attributes
    ----------
    best : Settled
        The most probable set.
    promises : tuple of Promise
        What each further hypothesis promised beside it.
    posterior : Posterior
        Over all sets that were fitted.
    nothing : Fit
        The nominal model with its parts re-estimated.
    sizes : tuple of int
        Of the set that each round started from.

    """

    best: Settled
    promises: tuple[Promise, ...]
    posterior: Posterior
    nothing: Fit
    sizes: tuple[int, ...]


@dataclass(frozen=True)
class _Fitter:
    """Fits sets around the linearisation of one near them."""

    centre: Settled
    duration: float

    def __call__(self, trial: Trial) -> Fit:
        return fitted(self.centre.likelihood, Causes(trial.hypotheses, self.duration),
                      trial.starts, self.centre.fit.scale)


@dataclass(frozen=True)
class _Leveller:
    """Fits sets around themselves, at another discrepancy."""

    nominal: Base
    data: Data

    def __call__(self, item: tuple[Trial, Level]) -> Fit:
        trial, level = item
        return Settled.at(trial, replace(self.nominal, discrepancy=level), self.data).fit


class _Course:
    """What all steps of a search share."""

    def __init__(self, data: Data, nominal: Base, jobs: int, exclude: Sequence[str],
                 progress: Progress):
        self.data, self.nominal, self.jobs, self.progress = data, nominal, jobs, progress
        self.catalogue = [h for h in hypotheses(nominal.robot, exclude)
                          if not any(h.effect is type(e) for e in nominal.effects)]
        self.known: dict[Key, Fit] = {}
        self.settled: dict[Key, Settled] = {}
        self.thin: Likelihood
        self.looks: list[tuple[Hypothesis, tuple[Look, ...]]] = []

    def settle(self, trial: Trial, level: Level, scale: Array | None = None) -> Settled:
        """Return a set fitted around itself, known from now on."""
        found = Settled.at(trial, replace(self.nominal, discrepancy=level), self.data, scale)
        self.known[Key.of(found.fit)] = found.fit
        self.settled[Key.of(found.fit)] = found
        return found

    def look(self, nothing: Settled) -> None:
        """Look at all hypotheses."""
        self.thin = nothing.likelihood.thinned(SAMPLES)
        self.looks = each(Looker(self.thin, self.data.duration), self.catalogue, self.jobs,
                          lambda share: self.progress('looking at all causes', 0.4 * share))

    def promises(self, centre: Settled, left_out: int | None = None) -> list[Promise]:
        """Return what all others promise beside a set, or beside it without one cause."""
        fit, likelihood = centre.fit, centre.likelihood
        rest = np.ones(len(fit.values), dtype=bool)
        residual, ends = centre.point.residual, centre.causes.ends
        if left_out is not None:
            rest[ends[left_out]:ends[left_out + 1]] = False
            effects = centre.causes.effects(fit.values)
            residual = likelihood.residual(effects[:left_out] + effects[left_out + 1:])[0]
        slab, columns = fit.moments.slab, centre.point.columns[rest]
        plain = residual - np.tensordot(fit.moments.away[rest], columns, 1)
        rows = np.concatenate([plain[None], columns, likelihood.columns])[..., self.thin.kept]
        weight = np.repeat(1.0 / (fit.scale * np.sqrt(TEMPER)), rows.shape[-1])
        beside = Beside(
            np.sqrt(self.thin.weight) * rows.reshape(len(rows), -1) * weight,
            np.concatenate([slab.width[rest], likelihood.tolerances]), weight,
            self.data.duration)
        labels = Trial.of(fit).labels
        found = [beside.promise(h, looks) for h, looks in self.looks if h.label not in labels]
        return sorted(found, key=lambda p: -self.hope(p))

    def hope(self, promise: Promise) -> float:
        """Return what a promise gains with its price, nats."""
        return promise.gain + log_odds(promise.hypothesis.effect, self.nominal.robot)

    def trials(self, centre: Settled, promises: Sequence[Promise]) -> Iterator[Trial]:
        """Return the sets near a set that are worth a fit."""
        now = Trial.of(centre.fit)
        least = max(WORTH, self.hope(promises[0]) - BEHIND) if promises else 0.0
        for promise in promises[:FITTED]:
            if self.hope(promise) > least:
                yield now.with_one(promise)
        for place in range(len(now.hypotheses)):
            rest = now.without(place)
            yield rest
            for promise in self.promises(centre, place)[:RIVALS]:
                yield rest.with_one(promise)

    def around(self, centre: Settled) -> list[Promise]:
        """Fit the sets near a set; return what further causes promise beside it."""
        promises = self.promises(centre)
        fits = each(_Fitter(centre, self.data.duration), list(self.trials(centre, promises)),
                    self.jobs, lambda share: self.progress(
                        f'cause {len(centre.fit.hypotheses) + 1}', 0.4 + 0.5 * share))
        self.known.update({Key.of(fit): fit for fit in fits
                           if Key.of(fit) not in self.settled})
        return promises

    def ranked(self) -> Posterior:
        """Return all sets that are known with their probabilities."""
        return Posterior.of(list(self.known.values()), self.nominal)

    def settle_leading(self) -> None:
        """Linearise the leading sets around themselves, so that they compare."""
        while len(self.settled) < SETTLED:
            ranked = self.ranked()
            rough = [fit for fit, p in zip(ranked.fits, ranked.probability)
                     if p > SHARE and Key.of(fit) not in self.settled]
            if not rough:
                return
            fit = rough[0]
            if attempt(lambda f: self.settle(Trial.of(f), f.discrepancy, f.scale), fit) is None:
                del self.known[Key.of(fit)]

    def try_unknown(self, centres: Sequence[Settled]) -> None:
        """Fit sets with a larger discrepancy, where errors exceed what the known one states."""
        if not np.any(centres[-1].fit.scale > EXCESS):
            return
        trials = [Trial.of(centre.fit) for centre in centres]
        fitter, both = _Leveller(self.nominal, self.data), UNKNOWN_LEVELS[0]
        found = each(fitter, [(trial, both) for trial in trials], self.jobs)
        if found:
            best = Trial.of(max(found, key=lambda f: f.log_evidence + log_prior(f, self.nominal)))
            found += each(fitter, [(best, level) for level in UNKNOWN_LEVELS[1:]], self.jobs)
        self.known.update({Key.of(fit): fit for fit in found})


def search(data: Data, nominal: Base, jobs: int, progress: Progress,
           exclude: Sequence[str] = ()) -> Search:
    """
    Return where a search among sets of causes ends.

    The most probable set is linearised around itself and its neighbours are fitted, until the
    most probable set is one whose neighbours are known.

    Parameters
    ----------
    data : Data
        The records.
    nominal : Base
        The model in question.
    jobs : int
        Processes.
    progress : Callable
        Told a step's name and its share done.
    exclude : sequence of str
        Identifiers to leave out of the catalogue.

    """
    course = _Course(data, nominal, jobs, exclude, progress)
    progress('nothing', 0.0)
    nothing = course.settle(Trial((), (np.zeros(0),)), nominal.discrepancy)
    course.look(nothing)
    promises = {Key.of(nothing.fit): course.around(nothing)}
    while len(promises) < EXPLORED:
        course.settle_leading()
        best = course.settled[Key.of(course.ranked().best)]
        if Key.of(best.fit) in promises:
            break
        promises[Key.of(best.fit)] = course.around(best)
    centres = [course.settled[key] for key in promises]
    last = max(centres, key=lambda c: c.fit.log_evidence + log_prior(c.fit, nominal))
    centres = [c for c in centres if c is not last] + [last]
    progress('unknown', 0.9)
    course.try_unknown(centres)
    course.settle_leading()
    posterior = course.ranked()
    best = course.settled.get(Key.of(posterior.best), last)
    return Search(best, tuple(promises[Key.of(last.fit)]), posterior, nothing.fit,
                  tuple(len(key.labels) for key in promises))
