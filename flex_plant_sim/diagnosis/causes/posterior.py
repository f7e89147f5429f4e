"""
The posterior over the sets of causes that were fitted, and what the verdict reads from it.

A set's score is its log-evidence with its log prior odds. Something unknown may belong to a set.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
import math
from types import MappingProxyType

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.likelihood.prior import (
    further_faults,
    imitation_odds,
    log_prior_odds,
    unknown_odds,
)
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
from flex_plant_sim.diagnosis.record.sensor_noise import NOISE_ERROR
from flex_plant_sim.diagnosis.record.windows import LOCKED_SHARE
from flex_plant_sim.interval import credible_values
import numpy as np

# Standard deviation, over arms, of the logarithm of the scale of a channel's slow errors: none has
# just the stated share of what every model misses (benchmarks/discrepancy.py).
SLOW_ERROR_SPREAD = 0.39
# Newton's steps to the likeliest noise: from none they rise to it, by half of ln s at the least.
NEWTON_STEPS = 40


@dataclass(frozen=True)
class SetKey:
    """What distinguishes sets: labels of the causes, their fixed values, the discrepancy."""

    labels: frozenset[str]
    discrepancy: DiscrepancyModel
    fixed: frozenset[tuple[str, tuple[float, ...]]] = frozenset()

    @classmethod
    def of(cls, fit: Fit) -> SetKey:
        """Return the key of a fit."""
        return cls(frozenset(h.label for h in fit.hypotheses), fit.discrepancy,
                   frozenset((h.label, h.fixed_values) for h in fit.hypotheses if h.fixed_values))

    @property
    def without_remainder(self) -> SetKey:
        """Return the key of the same set without an unknown remainder."""
        return replace(self, discrepancy=replace(self.discrepancy, remainder=False))

    def without(self, label: str) -> SetKey:
        """Return the key of the set without one of its causes."""
        return replace(self, labels=self.labels - {label},
                       fixed=frozenset(item for item in self.fixed if item[0] != label))


def is_unknown(fit: Fit, nominal: BaseModel) -> bool:
    """Tell whether something unknown belongs to a set."""
    return fit.discrepancy != nominal.discrepancy


def interpretations(fit: Fit, parts_vary: bool = False) -> tuple[Fit, ...]:
    """
    Return a fit read as complete, and as one with an unknown remainder.

    A complete set leaves errors no larger than any model's, as on clean arms of other simulators.
    Larger errors cost it what `cost_of_white_errors` says or, if that is more, what the slow
    errors of the worst channel do, which are a few of all: what an arm's model misses, many
    channels see. With a remainder, the errors cost nothing. It shows in them, as far as they are
    not just white, or in a cause that varies, see `constancy`, or a part.

    Parameters
    ----------
    fit : Fit
        Of a set.
    parts_vary : bool
        Whether parts may vary. While causes are searched for they may not: a set is then judged
        by what it explains, and not by what a part could explain in place of the rest.

    """
    white = cost_of_white_errors(fit.error_scale, fit.statistics.samples)
    slow = cost_of_white_errors(fit.slow_scale, fit.slow_means,
                                SLOW_ERROR_SPREAD**2 * fit.slow_means)
    cost = float(max(np.sum(white), np.max(slow, initial=0.0)))
    in_errors = math.log(-math.expm1(-cost)) if cost else -math.inf
    by_parts = shown_by_parts(fit) if parts_vary else -math.inf
    gain = float(np.logaddexp.reduce([fit.varying_gain, in_errors, by_parts]))
    if gain == -math.inf:
        return (fit,)
    return (replace(fit, log_evidence=fit.log_evidence - cost),
            replace(fit, discrepancy=replace(fit.discrepancy, remainder=True),
                    log_evidence=fit.log_evidence + gain))


def shown_by_parts(fit: Fit) -> float:
    """Return the gain of the evidence if one part, any, varies, as far as it shows, nats."""
    gains = fit.varying_part_gains
    if not gains.size:
        return -math.inf
    gain = float(np.logaddexp.reduce(gains)) - math.log(gains.size)
    return gain + math.log(-math.expm1(-gain)) if gain > 0.0 else -math.inf


def cost_of_white_errors(scale: Array, samples: float | Array,
                         variance: float | Array = NOISE_ERROR**2 * (1.0 - LOCKED_SHARE)) -> Array:
    """
    Return what errors of some scales, beyond 1, cost where they are white noise, nats, (m,).

    The log-ratio of white errors of the stated scale to those of the actual scale, at the
    likeliest noise: what is stated has an error of its own. All samples count, as the errors of
    clean arms are white (benchmarks/temper.py); the temper is for errors that go with the motion.
    """
    # ln of the noise over what is stated, u, has variance v / N; it is from locked samples, too.
    larger, v = np.log(np.maximum(scale, 1.0)), variance
    u = np.zeros_like(larger)
    for _ in range(NEWTON_STEPS):
        excess = np.expm1(2.0 * (larger - u))
        u += (v * excess - u) / (2.0 * v * (1.0 + excess) + 1.0)
    left = 2.0 * (larger - u)
    return np.asarray(0.5 * samples * (np.expm1(left) - left + u**2 / v))


def log_prior(fit: Fit, nominal: BaseModel) -> float:
    """
    Return the logarithm of a set's prior odds against `nothing`, nats.

    Something unknown is a far part with probability 1/2, and anything else with 1/2. A far part
    that leaves a remainder is two unknown things.
    """
    log_odds = log_prior_odds_of_causes(fit, nominal)
    one, found = math.log(0.5 * unknown_odds()), fit.discrepancy
    if found.far_part:
        log_odds += one - math.log(fit.statistics.tolerances.size)
    if replace(found, far_part='') != nominal.discrepancy:
        log_odds += one - sum(found.law_penalties)
    return log_odds


def log_prior_odds_of_causes(fit: Fit, nominal: BaseModel) -> float:
    """Return the logarithm of the prior odds of a set's causes, nats."""
    return sum(log_prior_odds(h.effect, nominal.robot) for h in fit.hypotheses)


@dataclass(frozen=True)
class _SetProbability:
    """
    A set: its causes, its probability if they are genuine, whether something is unknown.

    `shown` are the causes that the record shows. One that it does not show is no fault more that
    something unknown would have to imitate.
    """

    labels: frozenset[str]
    probability: float
    unknown: bool
    shown: frozenset[str]

    @property
    def genuine_probability(self) -> float:
        """Return the probability that a cause of the set is not imitated by something unknown."""
        return 1.0 / (1.0 + imitation_odds(further_faults(self.shown, self.unknown)))


@dataclass(frozen=True)
class Posterior:
    """
    Sets of causes with their probabilities, the most probable first.

    Attributes
    ----------
    fits : tuple of Fit
    probability : Array
        Of each, (S,); together with those of the sets that were not fitted they sum to one.
    nominal : BaseModel
    unfitted : Mapping
        Labels of sets that were not fitted to their probabilities.
    beside : Fit, optional
        The set that those are beside, which have one cause more: as it was read.

    """

    fits: tuple[Fit, ...]
    probability: Array
    nominal: BaseModel
    unfitted: Mapping[frozenset[str], float] = field(default_factory=dict)
    beside: Fit | None = None

    @classmethod
    def of(cls, fits: Sequence[Fit], nominal: BaseModel,
           unfitted_scores: Mapping[frozenset[str], float] = MappingProxyType({}),
           beside: Fit | None = None, parts_vary: bool = False) -> Posterior:
        """
        Return the posterior over sets.

        Parameters
        ----------
        fits : sequence of Fit
            Of the sets that were fitted; each counts in both of its `interpretations`.
        nominal : BaseModel
            The model in question.
        unfitted_scores : Mapping
            Labels of sets that were not fitted to their estimated scores, nats.
        beside : Fit, optional
            The set that those are beside, as it was read.
        parts_vary : bool
            See `interpretations`.

        """
        fits = [reading for fit in fits for reading in interpretations(fit, parts_vary)]
        score = np.array([fit.log_evidence + log_prior(fit, nominal) for fit in fits])
        return cls.from_scores(fits, score, nominal, unfitted_scores, beside)

    @classmethod
    def from_scores(cls, fits: Sequence[Fit], score: Array, nominal: BaseModel,
                    unfitted_scores: Mapping[frozenset[str], float] = MappingProxyType({}),
                    beside: Fit | None = None) -> Posterior:
        """Return the posterior over sets whose log posterior odds, nats, are the scores, (S,)."""
        order, known = np.argsort(-score), {SetKey.of(fit).labels for fit in fits}
        top = score[order[0]]
        weight = np.exp(score[order] - top)
        others = {labels: math.exp(min(value - top, 0.0))
                  for labels, value in unfitted_scores.items() if labels not in known}
        total = weight.sum() + sum(others.values())
        return cls(tuple(fits[k] for k in order), weight / total, nominal,
                   {labels: value / total for labels, value in others.items()},
                   beside)

    @property
    def best(self) -> Fit:
        """Return the most probable set."""
        return self.fits[0]

    @property
    def _set_probabilities(self) -> list[_SetProbability]:
        """Return all sets, those fitted first."""
        fitted = [_SetProbability(labels, float(p), is_unknown(fit, self.nominal), labels)
                  for fit, p in zip(self.fits, self.probability)
                  for labels in [SetKey.of(fit).labels]]
        unknown = self.beside is not None and is_unknown(self.beside, self.nominal)
        shown = SetKey.of(self.beside).labels if self.beside is not None else frozenset[str]()
        return [*fitted, *(_SetProbability(labels, p, unknown, shown)
                           for labels, p in self.unfitted.items())]

    @property
    def genuine_probability(self) -> float:
        """Return the probability that a cause of the best set is not an imitation."""
        return self._set_probabilities[0].genuine_probability

    def effect_probability(self, identifier: str) -> float:
        """Return the probability that an effect is at work at any site."""
        return sum(s.probability * s.genuine_probability for s in self._set_probabilities if any(
            label.partition(':')[0] == identifier for label in s.labels))

    @property
    def nothing_probability(self) -> float:
        """Return the probability that nothing is wrong."""
        return self._sum(lambda fit: not fit.hypotheses and not is_unknown(fit, self.nominal))

    @property
    def unknown_probability(self) -> float:
        """Return the probability that something unknown is at work."""
        return 1.0 - sum(s.probability * (s.genuine_probability if s.labels else 1.0)
                         for s in self._set_probabilities if not s.unknown)

    def _sum(self, holds: Callable[[Fit], bool]) -> float:
        return float(sum(p for fit, p in zip(self.fits, self.probability) if holds(fit)))

    def alternatives(self, label: str) -> dict[str, float]:
        """
        Return what may stand in the place of a cause of the best set, with its probability.

        Labels of causes, 'unknown' or 'nothing', from the sets that have all other causes of the
        best set. A cause that only stands beside the one asked about does not count.
        """
        others = SetKey.of(self.best).labels - {label}
        found: dict[str, float] = {}
        for fit, p in zip(self.fits, self.probability):
            labels = SetKey.of(fit).labels
            if not others <= labels:
                continue
            for name in {label} & labels or labels - others or {
                    'unknown' if is_unknown(fit, self.nominal) else 'nothing'}:
                found[name] = found.get(name, 0.0) + float(p)
        return dict(sorted(found.items(), key=lambda item: -item[1]))

    def credible_alternatives(self, label: str) -> tuple[str, ...]:
        """Return the fewest alternatives to a cause that hold CREDIBLE_LEVEL, itself included."""
        return credible_values(self.alternatives(label))
