"""The steps of a search: looks, promises, fits near a set, sets linearised around themselves."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import replace

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.factors import in_place_of_parts
from flex_plant_sim.diagnosis.causes.fit import EXCESS, Fit, with_far_part
from flex_plant_sim.diagnosis.causes.hypothesis import hypotheses, Hypothesis
from flex_plant_sim.diagnosis.causes.looks import Look, Looker
from flex_plant_sim.diagnosis.causes.posterior import judged, Key, log_prior, Posterior
from flex_plant_sim.diagnosis.causes.promise import Beside, Promise
from flex_plant_sim.diagnosis.causes.sets import AGAIN, Fitter, Settled, Trial
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.moments import TEMPER
from flex_plant_sim.diagnosis.likelihood.prior import far_parts, log_odds
from flex_plant_sim.diagnosis.pool import attempt, each
from flex_plant_sim.diagnosis.prediction.discrepancy import Amplitude
from flex_plant_sim.diagnosis.prediction.latent_view import latent_view, table
from flex_plant_sim.diagnosis.prediction.predictor import Base, Predictor
from flex_plant_sim.diagnosis.record.data import Data
import numpy as np

Progress = Callable[[str, float], None]

# A budget, no judgement: hypotheses tried beside a set and in place of each, sets fitted to all
# windows, samples of those windows that proposals come from.
ADDED, RIVALS, FITTED, REFITTED, SAMPLES = 12, 5, 6, 1, 1600
# What promises less than this, nats with its price, has no share worth stating, but for the few
# best; nor has what a fit to some windows leaves so far behind, nor a set less probable.
WORTH, LEAST, BEHIND, SHARE = -1.0, 2, 30.0, 0.05
# Around another set, a fit knows its gain over that to such a share: parts go where they were not
# linearised. So many of those that may lead are linearised around themselves at a time.
KNOWN, LEADING = 0.3, 3
# What promises less than this share of a cause cannot stand in its place; one that promises more
# than this, nats, is not dropped.
RIVAL, SURE = 0.3, 60.0


class Course:
    """What all steps of a search share."""

    def __init__(self, data: Data, nominal: Base, jobs: int, exclude: Sequence[str],
                 progress: Progress):
        self.data, self.nominal, self.jobs, self.progress = data, nominal, jobs, progress
        self.catalogue = [h for h in hypotheses(nominal.robot, exclude)
                          if not any(h.effect is type(e) for e in nominal.effects)]
        self.known: dict[Key, Fit] = {}
        self.settled: dict[Key, Settled] = {}
        self.thin: Likelihood
        self.about: Array | None = None
        self.looks: list[tuple[Hypothesis, tuple[Look, ...]]] = []
        # Labels of what has a coordinate of its own: its size is a frequency.
        self.swinging: frozenset[str] = frozenset()
        self.rough: dict[Key, list[Fit]] = {}

    def sensed(self) -> Course:
        """
        Return the course as it begins anew where sensors see what is unmodelled.

        What the arms' own filters err is the same: all looks, and the rough fits beside nothing.
        """
        def moved(fit: Fit) -> Fit:
            return replace(fit, discrepancy=replace(fit.discrepancy, sensed=True))

        other, level = copy(self), replace(self.nominal.discrepancy, sensed=True)
        other.nominal = replace(self.nominal, discrepancy=level)
        other.known, other.settled = {}, {}
        nothing = Key(frozenset(), self.nominal.discrepancy)
        other.rough = {replace(nothing, level=level): [moved(f) for f in self.rough[nothing]]}
        other.about = self.settled[nothing].fit.deviations
        return other

    def settle(self, trial: Trial, level: Amplitude, scale: Array | None = None) -> Settled:
        """Return a set fitted around itself, the best of its ends, known from now on."""
        return self._kept(self._settled(trial, level, scale))

    def _settled(self, trial: Trial, level: Amplitude, scale: Array | None) -> Settled:
        base = replace(self.nominal, discrepancy=level)
        return Settled.at(trial, base, self.data, scale, self.jobs, self.matters)

    def _settle_each(self, fits: Sequence[Fit]) -> None:
        """Settle what was fitted, side by side: none is told what another finds."""
        for found in each(lambda fit: self._settled(Trial.of(fit), fit.discrepancy, fit.scale),
                          fits, self.jobs):
            self._kept(found)

    def _kept(self, found: Settled) -> Settled:
        """Return the better of what was found and what is known of the set, known from now on."""
        key = Key.of(found.fit)
        found = max(found, self.settled.get(key, found), key=lambda s: self.score(s.fit))
        self.known[key], self.settled[key] = found.fit, found
        return found

    def matters(self, fit: Fit, more: float = 0.0) -> bool:
        """Tell whether a fit has a share worth stating beside the best, had it more nats."""
        best = max((self._judged(s.fit) for s in self.settled.values()), default=-np.inf)
        return self._judged(fit) + more > best + np.log(SHARE)

    def _judged(self, fit: Fit) -> float:
        """Return the score of the likelier of what a fit stands for, nats."""
        return max(map(self.score, judged(fit)))

    def try_laws(self, explored: Settled) -> None:
        """
        Fit a set with the laws of the torques that it leaves, where joints err too much.

        A further cause must explain more than the tables of torques that have no name. And what
        leads with those of another set has its own.
        """
        if not np.any(self.best.fit.scale[:2] > EXCESS):
            return
        if not explored.fit.discrepancy.laws:
            self._settle_with_laws(explored)
        best = self.best
        if best.fit.discrepancy.laws and best.fit.hypotheses != explored.fit.hypotheses:
            self._settle_with_laws(best)

    def _settle_with_laws(self, centre: Settled) -> None:
        """
        Linearise a set with the laws that hold of what it leaves around itself.

        Of joints that err too much: another's may be an echo, or a part within its tolerance.
        What laws leave of their errors are torques, too, at most as large as without them.
        """
        base = centre.extended(self.nominal)
        view = latent_view([Predictor(base, windows, noise) for windows, noise
                            in zip(self.data.locked, self.data.noise)])
        wrong = {f'joint_{k + 1}' for k in np.flatnonzero(centre.fit.scale[:2] > EXCESS)}
        laws = [law for law in view.laws if law.site in wrong]
        if laws:
            level = replace(centre.fit.discrepancy, laws=tuple(map(table, laws)),
                            asked=sum(law.asked for law in laws), torque=torques_left(centre.fit))
            scale = np.concatenate([np.ones(2), centre.fit.scale[2:]])
            attempt(lambda trial: self.settle(trial, level, scale), Trial.of(centre.fit))

    def look(self, nothing: Settled) -> None:
        """Look at all hypotheses."""
        self.thin = nothing.from_afar.likelihood.thinned(SAMPLES)
        self.looks = each(Looker(self.thin, self.data.duration), self.catalogue, self.jobs,
                          lambda share: self.progress('looking at all causes', 0.4 * share))
        self.swinging = frozenset(h.label for h, (look, *_) in self.looks
                                  if self.thin.at_rest((h.at(look.shape + look.away),)))

    def beside(self, centre: Settled, left_out: int | None = None) -> Beside:
        """
        Return what promises beside a set, or beside it without one cause, are measured against.

        Proposals and rough fits go by the arms' own filters: what those err has fewer side
        valleys, and no error of one channel drowns it. Evidence does not.
        """
        centre = centre.from_afar
        fit, likelihood = centre.fit, centre.likelihood
        rest = np.ones(len(fit.values), dtype=bool)
        residual, ends = centre.point.residual, centre.causes.ends
        if left_out is not None:
            rest[ends[left_out]:ends[left_out + 1]] = False
            effects = centre.causes.effects(fit.values)
            residual = likelihood.residual(effects[:left_out] + effects[left_out + 1:])[0]
        columns = centre.point.columns[rest]
        plain = residual - np.tensordot(fit.moments.away[rest], columns, 1)
        rows = np.concatenate([plain[None], columns, likelihood.columns])[
            ..., self.thin.kept]
        weight = np.repeat(1.0 / (fit.scale * np.sqrt(TEMPER)), rows.shape[-1])
        return Beside(
            np.sqrt(self.thin.weight) * rows.reshape(len(rows), -1) * weight,
            np.concatenate([fit.moments.slab.width[rest], likelihood.tolerances]), weight,
            self.data.duration)

    def promises(self, centre: Settled, left_out: int | None = None) -> list[Promise]:
        """Return what all others promise beside a set, see `beside`, the best first."""
        beside, on = self.beside(centre, left_out), centre.fit.hypotheses
        labels = {h.label for k, h in enumerate(on) if k != left_out}
        found = [beside.promise(h, looks) for h, looks in self.looks if h.label not in labels]
        return sorted(found, key=lambda p: -self.hope(p))

    def hope(self, promise: Promise) -> float:
        """Return what a promise gains with its price, nats."""
        return promise.gain + log_odds(promise.hypothesis.effect, self.nominal.robot)

    def worth(self, place: int, promise: Promise) -> bool:
        """
        Tell whether a promise is worth a fit, by its place among the promises.

        What swings gains more than a line tells: its place is not known.
        """
        placed = place < ADDED or promise.hypothesis.label in self.swinging
        return place < LEAST or (placed and self.hope(promise) > WORTH)

    def trials(self, centre: Settled, promises: Sequence[Promise]) -> Iterator[Trial]:
        """Return a set and those near it that may be worth a fit."""
        now = Trial.of(centre.fit)
        yield now
        added = [p for k, p in enumerate(promises) if self.worth(k, p)]
        for promise in {p.hypothesis.label: p for p in reversed(added)}.values():
            yield from self._with(now, promise)
        for place, cause in enumerate(now.hypotheses):
            rest, others = now.without(place), self.promises(centre, place)
            own = max((self.hope(p) for p in others if p.hypothesis == cause), default=0.0)
            if own < SURE:
                yield rest
            rivals = [p for p in others if p.hypothesis != cause and self.hope(p) > RIVAL * own]
            for promise in rivals[:RIVALS]:
                yield from self._with(rest, promise)

    def _with(self, trial: Trial, promise: Promise) -> Iterable[Trial]:
        """Return a set with one cause more; of one that swings, from each of its sizes."""
        if promise.hypothesis.label in self.swinging:
            return trial.with_each(promise)
        return [trial.with_one(promise)]

    def around(self, centre: Settled) -> list[Promise]:
        """Fit the sets near a set; return what further causes promise beside it."""
        promises, step = self.promises(centre), f'cause {len(centre.fit.hypotheses) + 1}'
        if Key.of(centre.fit) not in self.rough:
            self.rough[Key.of(centre.fit)] = self._rough(centre, promises, step)
        rough = sorted(self.rough[Key.of(centre.fit)], key=lambda fit: -self.score(fit))
        near = [fit for fit in rough if Key.of(fit) != Key.of(centre.fit)
                and self.score(fit) > self.score(rough[0]) - self.reach(rough[0], centre, BEHIND)]
        fits = each(Fitter(centre.likelihood, centre.fit.scale, self.data.duration),
                    [Trial.of(fit) for fit in self._chosen(near)], self.jobs,
                    lambda share: self.progress(step, 0.7 + 0.2 * share))
        in_place = tuple(in_place_of_parts(self.settled[Key.of(centre.fit)], self.catalogue))
        for fit in (*fits, *in_place):
            known = self.known.get(Key.of(fit), fit)
            if Key.of(fit) not in self.settled or self.score(fit) > self.score(known) + AGAIN:
                self.known[Key.of(fit)] = fit
        self._settle(in_place, self.ranked().best, centre)
        return promises

    def _rough(self, centre: Settled, promises: Sequence[Promise], step: str) -> list[Fit]:
        """Return the sets near a set as some windows and the arms' own filters see them."""
        afar = centre.from_afar
        fits = each(Fitter(afar.likelihood.thinned(SAMPLES), afar.fit.scale,
                           self.data.duration, True),
                    list(self.trials(centre, promises)), self.jobs,
                    lambda share: self.progress(step, 0.4 + 0.3 * share))
        # Of those that were fitted from several sizes, the best.
        return list({Key.of(fit): fit for fit in sorted(fits, key=self.score)}.values())

    def _chosen(self, near: Sequence[Fit]) -> list[Fit]:
        """Return the first of what is not settled, and of what is, from where it came now."""
        fresh = [fit for fit in near if Key.of(fit) not in self.settled]
        return fresh[:FITTED] + [fit for fit in near if Key.of(fit) in self.settled][:REFITTED]

    def reach(self, best: Fit, centre: Settled, least: float) -> float:
        """Return by how much a set may be behind the best around another and yet lead, nats."""
        return max(KNOWN * (self.score(best) - self.score(centre.fit)), least)

    def score(self, fit: Fit) -> float:
        """Return the logarithm of a set's posterior odds against others, nats."""
        return fit.log_evidence + log_prior(fit, self.nominal)

    def ranked(self, centre: Settled | None = None, promises: Sequence[Promise] = ()
               ) -> Posterior:
        """Return all sets with their probabilities, and what promised too little to be fitted."""
        promised = {} if centre is None else {
            Key.of(centre.fit).labels | {p.hypothesis.label}:
            self._judged(centre.fit) + self.hope(p)
            for k, p in enumerate(promises) if not self.worth(k, p)}
        return Posterior.of(list(self.known.values()), self.nominal, promised)

    @property
    def best(self) -> Settled:
        """Return the most probable set linearised around itself, all parts as their file says."""
        return max((s for s in self.settled.values() if not s.fit.discrepancy.far),
                   key=lambda s: self.score(s.fit))

    def settle_leading(self, centre: Settled) -> None:
        """
        Linearise the sets that may lead around themselves, so that they compare.

        Those around the file's parts compare with one another alone.
        """
        fits = self.ranked().fits
        if centre.fit is not self.settled[Key.of(centre.fit)].fit:
            fits = tuple(fit for fit in fits if Key.of(fit).plain not in self.settled)
        if fits:
            self._settle(fits[:LEADING], fits[0], centre)

    def settle_rivals(self, best: Settled, centre: Settled) -> None:
        """Linearise what is likeliest in the place of each cause of a set around itself."""
        ranked, labels = self.ranked(), Key.of(best.fit).labels
        rivals = {label: fit for fit in reversed(ranked.fits) for label in labels
                  if labels - Key.of(fit).labels == {label}}
        self._settle(tuple(rivals.values()), ranked.best, centre)

    def _settle(self, fits: Sequence[Fit], best: Fit, centre: Settled) -> None:
        """Linearise sets, as judged, around themselves that may lead for all a centre knows."""
        least = self.score(best) - self.reach(best, centre, -np.log(SHARE))
        settled = [found.fit for found in self.settled.values()]
        leading = dict.fromkeys(Key.of(fit).plain for fit in fits if self.score(fit) >= least)
        # What cannot be settled is known no more.
        self._settle_each([
            self.known.pop(key) for key in leading
            if key in self.known and not any(self.known[key] is fit for fit in settled)])

    def try_far_parts(self) -> None:
        """
        Judge the settled sets with each part not as its file says; that costs no pass.

        What a part far off gains is known to a share only: what may lead is fitted around it.
        """
        asked = {h.effect.identifier for h in self.catalogue}
        best = max(map(self.score, self.known.values()))
        may_lead = []
        for centre in self.settled.values():
            parts = centre.likelihood.parts
            names = far_parts(self.nominal.robot, parts, asked)
            found = max((with_far_part(centre.fit, part.name, k) for k, part in enumerate(parts)
                         if part.name in names), key=self.score)
            if self.score(found) > best - self.reach(found, centre, -np.log(SHARE)):
                may_lead.append(found)
        self._settle_each(may_lead)


def torques_left(fit: Fit) -> tuple[float, float]:
    """
    Return how large the torques are to which errors of joints are due, shares as in Amplitude.

    Errors so many times those stated are torques so many times those stated: slow ones. Were the
    sensor's noise as many times larger, it would hide what is fast and well known.
    """
    first, second = np.multiply(fit.discrepancy.torque, np.maximum(fit.scale[:2], 1.0))
    return float(first), float(second)
