"""From fits to a ranking: gains, relevance, parsimony, look-alikes, probabilities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.held_out.allowance import misfit, still_wrong
from flex_plant_sim.diagnosis.held_out.fit import Fit
from flex_plant_sim.diagnosis.held_out.gain import held_out, spread
from flex_plant_sim.diagnosis.held_out.hypothesis import Hypothesis
from flex_plant_sim.diagnosis.verdict.results import Candidate, ParameterValue
import numpy as np
from scipy.special import stdtrit

TIE = 0.02
TIE_NATS = 3.0
LOOK_ALIKE = 0.5
LEAST_T, LEAST_T_TO_CHOOSE = 2.5, 1.2
LEAST_POSITIVE = 0.6
LEAST_EXPLAINED, LEAST_SHARE = 1.0, 0.25
PARAMETER_NATS = 3.0
EVENT_NATS = 20.0


@dataclass(frozen=True)
class Ranked:
    """A fit and what it is worth; misfit and explained are in allowances per channel, (m,)."""

    fit: Fit
    window_gain: Array
    misfit: Array
    explained: Array

    @property
    def hypothesis(self) -> Hypothesis:
        """Return the hypothesis; a ranked fit always has one."""
        assert self.fit.hypothesis is not None
        return self.fit.hypothesis

    @property
    def gain(self) -> float:
        """Return the held-out gain, nats."""
        return float(self.window_gain.sum())

    @property
    def t(self) -> float:
        """Return mean over standard error of the windows' gains."""
        error = self.window_gain.std(ddof=1) / np.sqrt(self.window_gain.size)
        return float(self.window_gain.mean() / max(error, 1e-12))

    @property
    def positive(self) -> float:
        """Return the share of windows that gain."""
        return float(np.mean(self.window_gain > 0.0))

    @property
    def share_left(self) -> float:
        """Return the largest misfit with it over the largest without."""
        return float(self.misfit.max() / (self.misfit + self.explained).max())

    @property
    def share_explained(self) -> float:
        """Return the largest share of a channel's misfit that it explains."""
        return float(np.max(self.explained / (self.misfit + self.explained)))

    @property
    def at_bound(self) -> bool:
        """
        Tell whether a value ran to a bound: there the effect stands for something else.

        An absent effect's values do not count, nor does a shape that is zero (no damping, say).
        """
        h, values = self.hypothesis, self.fit.values
        zero = np.logical_not(h.sizes) & (values == 0.0)
        ends = (values <= h.low) & (h.low != h.null) | (values >= h.high) & (h.high != h.null)
        return bool(np.any(ends & np.logical_not(zero)))

    @property
    def relevant(self) -> bool:
        """
        Tell whether it may be named.

        It explains more than an allowance and a good part of what is wrong with a channel, on
        most windows, with a size that matters in practice and off its bounds.
        """
        return bool(self.gain > 0.0 and self.explained.max() >= LEAST_EXPLAINED
                    and self.share_explained >= LEAST_SHARE
                    and self.hypothesis.relevance(self.fit.values) >= 1.0 and not self.at_bound
                    and (self.t >= LEAST_T or self.positive >= LEAST_POSITIVE
                         or self._plain_event))

    @property
    def may_be_chosen(self) -> bool:
        """Tell whether it is relevant, and not by a single window's doing unless an event."""
        return self.relevant and (self.t >= LEAST_T_TO_CHOOSE or self._plain_event)

    @property
    def _plain_event(self) -> bool:
        return self.hypothesis.is_event and self.gain >= EVENT_NATS


def rank(fits: Sequence[Fit], base: Fit, noise: Sequence[Array], allowed: Array) -> list[Ranked]:
    """
    Return the fits, best held-out gain first; gains are tempered like the best one.

    Where the best leaves nothing that counts as wrong, what is left is model error, and whitened
    residuals decide.
    """
    if not fits:
        return []
    start = misfit(base.residual, noise, allowed)
    ranked = _ranked(fits, base, start, noise, allowed, whitened=False)
    if still_wrong(start, ranked[0].misfit).any():
        return ranked
    return _ranked(fits, base, start, noise, allowed, whitened=True)


def _ranked(fits: Sequence[Fit], base: Fit, start: Array, noise: Sequence[Array],
            allowed: Array, whitened: bool) -> list[Ranked]:
    before = held_out(base, whitened) * base.weighting.temper
    raw = [held_out(fit, whitened) * fit.weighting.temper - before for fit in fits]
    best = max(range(len(fits)), key=lambda k: raw[k].sum())
    temper = fits[best].weighting.temper
    ranked = []
    for fit, gain in zip(fits, raw):
        left = misfit(fit.residual, noise, allowed)
        ranked.append(Ranked(fit, gain / temper, left, start - left))
    return sorted(ranked, key=lambda r: -r.gain)


def choose(ranked: Sequence[Ranked]) -> Ranked | None:
    """Return the simplest of the best: fewest parameters within a tie in gain."""
    relevant = [r for r in ranked if r.may_be_chosen]
    if not relevant:
        return None
    tie = relevant[0].gain - max(TIE_NATS, TIE * relevant[0].gain)
    near = [r for r in relevant if r.gain >= tie]
    return min(near, key=lambda r: (len(r.fit.values), -r.gain))


def clear_of_null(ranked: Ranked) -> bool:
    """
    Tell whether some size's 95 % interval leaves out that the effect is absent.

    A count of modes has no slope and so no such interval; its gain alone speaks for it.
    """
    if ranked.hypothesis.effect.reshapes:
        return True
    return any(size and (value.low > null or value.high < null)
               for value, null, size in zip(parameter_values(ranked.fit), ranked.hypothesis.null,
                                            ranked.hypothesis.sizes))


def look_alikes(chosen: Ranked, ranked: Sequence[Ranked]) -> tuple[Ranked, ...]:
    """Return other effects that leave practically the same residual."""
    close, seen = [], {chosen.hypothesis.effect.identifier}
    for other in ranked:
        name = other.hypothesis.effect.identifier
        worse = np.max(other.misfit - chosen.misfit)
        if name not in seen and other.relevant and worse < LOOK_ALIKE:
            close.append(other)
            seen.add(name)
    return tuple(close)


def probabilities(ranked: Sequence[Ranked], chosen: Ranked | None) -> Array:
    """
    Return each hypothesis's probability given that the catalogue holds the cause, (H,).

    Gains count relative to the best one: a model that is one percent wrong cannot tell gains
    apart that differ by a few percent. Every further parameter costs three nats, half the
    logarithm of some five hundred independent samples (Schwarz, Annals of Statistics 6 (1978)):
    the 12 000 that are fitted count for about that many, coloured as they are.
    """
    if chosen is None:
        return np.zeros(len(ranked))
    scale = TIE_NATS + TIE * max(chosen.gain, 0.0)
    score = np.array([r.gain / scale - PARAMETER_NATS * len(r.fit.values)
                      if r.relevant else -np.inf for r in ranked])
    weight = np.exp(score - score.max())
    return weight / weight.sum()


def parameter_values(fit: Fit) -> tuple[ParameterValue, ...]:
    """Return values with 95 % intervals: the wider of curvature and window-to-window spread."""
    assert fit.hypothesis is not None
    count = len(fit.values)
    curvature = spread(fit)
    root = np.sqrt(fit.weighting.temper)
    columns = fit.weighting.white_columns(fit.directions) / root
    white = fit.weighting.white(fit.residual) / root
    score = np.einsum('wtmk,wtm->wk', columns, white)
    windows = len(score)
    sandwich = curvature @ (score.T @ score) @ curvature * windows / max(windows - 1, 1)
    variance = np.maximum(np.diagonal(curvature), np.diagonal(sandwich))[:count]
    reach = stdtrit(max(windows - 1, 2), 0.975) * np.sqrt(variance)
    low, high = fit.hypothesis.low, fit.hypothesis.high
    return tuple(
        ParameterValue(p.name, float(v), float(max(v - r, a)), float(min(v + r, b)), p.unit)
        for p, v, r, a, b in zip(fit.hypothesis.parameters, fit.values, reach, low, high))


def candidate(ranked: Ranked, probability: float) -> Candidate:
    """Return the row of a ranking."""
    return Candidate(ranked.hypothesis.effect.identifier, ranked.hypothesis.site,
                     parameter_values(ranked.fit), ranked.gain,
                     tuple(float(g) for g in ranked.window_gain), ranked.t, ranked.positive,
                     probability, ranked.relevant)
