"""Causes beside each other: refitted, dropped or exchanged for what explains them better."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from flex_plant_sim.diagnosis.held_out.candidate_pass import Data, decided, one_pass, rivals, Round
from flex_plant_sim.diagnosis.held_out.fit import Fit, fit_base, refine
from flex_plant_sim.diagnosis.held_out.hypothesis import Hypothesis
from flex_plant_sim.diagnosis.held_out.problem import Problem
from flex_plant_sim.diagnosis.held_out.ranking import choose, rank, Ranked
from flex_plant_sim.diagnosis.prediction.predictor import Base

SWEEPS = 3

Grounds = Mapping[Hypothesis, Round]


def exchanged(base: Base, nominal: Base, accepted: Sequence[Ranked], grounds: Grounds,
              data: Data, jobs: int) -> tuple[list[Ranked], dict[Hypothesis, Round]]:
    """
    Return the accepted effects, each the best beside the others, and the rounds that say so.

    An effect is chosen while those found later are still missing, when a look-alike may win.
    So each in turn is taken out and ranked again, with the others on, among its rivals of then
    (its round in `grounds`). After an exchange those that it makes superfluous are dropped.
    """
    kept, told = list(accepted), dict(grounds)
    for _ in range(SWEEPS):
        before = [r.hypothesis for r in kept]
        for place, ranked in enumerate(kept):
            others = kept[:place] + kept[place + 1:]
            again = _ranked_again(base, nominal, ranked, others, told[ranked.hypothesis], data,
                                  jobs)
            kept[place], told[again[0].hypothesis] = again
        if [r.hypothesis for r in kept] == before:
            break
        kept = still_needed(base, nominal, kept, data)
    return kept, told


def _ranked_again(base: Base, nominal: Base, ranked: Ranked, others: Sequence[Ranked],
                  found: Round, data: Data, jobs: int) -> tuple[Ranked, Round]:
    """Return what explains best, with the others on, what one effect does; and the ranking."""
    without = replace(extended_base(base, nominal, others), level=base.level)
    problem = Problem(without, data.windows, data.noise)
    fitted = fit_base(problem)
    taken = {ranked.hypothesis, *(r.hypothesis for r in others)}
    open_ones = [h for h in rivals(found) if h not in taken]
    passed = one_pass(problem, fitted, open_ones, data, jobs).ranked if open_ones else ()
    fits = [refine(problem, ranked.fit), *(r.fit for r in passed)]
    listed = rank(fits, fitted, data.noise, data.allowed)
    problem, again = decided(problem, Round(fitted, tuple(listed), choose(listed)), data, jobs)
    if again.chosen is None:
        return ranked, found
    if again.chosen.hypothesis != ranked.hypothesis:
        ranked = refitted(problem, again.chosen, again.base, data)
    return ranked, again


def extended_base(base: Base, nominal: Base, accepted: Sequence[Ranked]) -> Base:
    """Return the base with the nominal level and effects, and those accepted as fitted."""
    return replace(base, level=nominal.level, effects=(*nominal.effects, *(
        r.hypothesis.at(r.fit.values) for r in accepted)))


def refitted(problem: Problem, ranked: Ranked, base: Fit, data: Data) -> Ranked:
    """Return the fit again, base parameters linearised with the effect on."""
    effect = ranked.hypothesis.at(ranked.fit.values)
    around = Problem(problem.base, data.windows, data.noise, (effect,), problem.judging)
    fit = refine(around, ranked.fit)
    return rank([fit], base, data.noise, data.allowed)[0]


def still_needed(base: Base, nominal: Base, accepted: Sequence[Ranked],
                 data: Data) -> list[Ranked]:
    """Return the accepted effects that the others do not make superfluous, refitted jointly."""
    kept = list(accepted)
    for ranked in accepted:
        others = [r for r in kept if r is not ranked]
        without = replace(extended_base(base, nominal, others), level=base.level)
        problem = Problem(without, data.windows, data.noise)
        fitted = fit_base(problem)
        again = refitted(problem, ranked, fitted, data)
        place = kept.index(ranked)
        kept[place:place + 1] = [again] if again.relevant else []
    return kept
