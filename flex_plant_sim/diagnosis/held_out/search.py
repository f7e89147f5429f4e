"""The search for causes: is anything wrong, what explains it, what else, what is left."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.held_out.allowance import misfit, still_wrong, WRONG
from flex_plant_sim.diagnosis.held_out.candidate_pass import Data, decided, one_pass, Round
from flex_plant_sim.diagnosis.held_out.exchange import (
    exchanged,
    extended_base,
    refitted,
    still_needed,
)
from flex_plant_sim.diagnosis.held_out.fit import Fit, fit_base, settle
from flex_plant_sim.diagnosis.held_out.hypothesis import hypotheses, Hypothesis
from flex_plant_sim.diagnosis.held_out.noise_level import likeliest_level
from flex_plant_sim.diagnosis.held_out.problem import Problem
from flex_plant_sim.diagnosis.held_out.ranking import clear_of_null, Ranked
from flex_plant_sim.diagnosis.prediction.predictor import Base
import numpy as np

ROUNDS = 6
LEFT = 0.5

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Search:
    """
    The search's whole course.

    Attributes
    ----------
    nominal, extended : Base
    rounds : tuple of Round
    accepted : tuple of Ranked
        Refitted around themselves.
    grounds : tuple of Round
        What speaks for each accepted one, beside the others.
    before, after : Array
        Misfit of the nominal and of the extended base in allowances per channel, (m,).
    final : Problem
        Around the extended base.

    """

    nominal: Base
    extended: Base
    rounds: tuple[Round, ...]
    accepted: tuple[Ranked, ...]
    grounds: tuple[Round, ...]
    before: Array
    after: Array
    final: Problem


def search(data: Data, nominal: Base, jobs: int, progress: Progress,
           exclude: Sequence[str] = ()) -> Search:
    """
    Return the course of a search: add the cause that helps most until nothing wrong is left.

    It runs in `jobs` processes, tells `progress` a step's name and its share done, and leaves the
    identifiers in `exclude` out of the catalogue.
    """
    rounds: list[Round] = []
    accepted: list[Ranked] = []
    grounds: dict[Hypothesis, Round] = {}
    raised = False
    problem, fitted = settle(nominal, data.windows, data.noise)
    before = after = misfit(fitted.residual, data.noise, data.allowed)
    while still_wrong(before, after).any() and len(rounds) < ROUNDS:
        known = {r.chosen.hypothesis for r in rounds if r.chosen is not None} | set(grounds)
        trial = [h for h in hypotheses(nominal.robot, exclude) if h not in known
                 and not any(h.effect is type(e) for e in nominal.effects)]
        told = partial(progress, f'round {len(rounds) + 1}')
        around, found = _round(problem, fitted, trial, data, jobs, told, raised)
        raised = around.base.level != nominal.level
        rounds.append(found)
        if found.chosen is None:
            break
        fresh = refitted(around, found.chosen, found.base, data)
        stated = {**grounds, fresh.hypothesis: found}
        taken = _taken(around.base, nominal, accepted, fresh, stated, data, jobs)
        if taken is None:
            continue
        accepted, grounds = taken
        problem, fitted = settle(extended_base(around.base, nominal, accepted), data.windows,
                                 data.noise)
        after = misfit(fitted.residual, data.noise, data.allowed)
    return Search(nominal, _estimated(problem, fitted), tuple(rounds), tuple(accepted),
                  tuple(grounds[r.hypothesis] for r in accepted), before, after, problem)


def _round(problem: Problem, fitted: Fit, trial: Sequence[Hypothesis], data: Data, jobs: int,
           progress: Callable[[float], None], raised: bool) -> tuple[Problem, Round]:
    """
    Return one pass through the catalogue, and the problem it was decided on.

    The process noise of a good model tells causes apart best. Where no cause explains most of
    what is wrong with it, it is re-estimated; so it is at once where it was before (`raised`).
    """
    found = None if raised else one_pass(problem, fitted, trial, data, jobs, progress)
    if found is not None and found.chosen is not None and found.chosen.share_left < LEFT:
        return decided(problem, found, data, jobs)
    level = likeliest_level(problem.base, data.windows, data.noise)
    if found is not None and level == problem.base.level:
        return decided(problem, found, data, jobs)
    noisier, anew = settle(replace(problem.base, level=level), data.windows, data.noise)
    again = one_pass(noisier, anew, trial, data, jobs, progress)
    if found is not None and again.chosen is None:
        return decided(problem, found, data, jobs)
    return decided(noisier, again, data, jobs)


def _taken(base: Base, nominal: Base, accepted: Sequence[Ranked], fresh: Ranked,
           grounds: dict[Hypothesis, Round], data: Data, jobs: int
           ) -> tuple[list[Ranked], dict[Hypothesis, Round]] | None:
    """Return the effects with a fresh one, and what speaks for each; None if it is not taken."""
    if not accepted:
        return [fresh], grounds
    if not (fresh.share_explained > LEFT or clear_of_null(fresh)):
        return None
    before = fit_base(Problem(base, data.windows, data.noise))
    grown = still_needed(base, nominal, [*accepted, fresh], data)
    if _more_wrong(base, nominal, grown, before, data):
        return None
    better, stated = exchanged(base, nominal, grown, grounds, data, jobs)
    changed = [r.hypothesis for r in better] != [r.hypothesis for r in grown]
    if changed and _more_wrong(base, nominal, better, before, data):
        return grown, grounds
    return better, stated


def _estimated(problem: Problem, fitted: Fit) -> Base:
    """Return the base with its parameters where the fit has them, if they moved at all."""
    if not problem.base.deviations:
        return problem.base
    kept = [value if item.settles else 0.0
            for item, value in zip(problem.nuisances, fitted.nuisance)]
    return replace(problem.base, deviations=tuple(map(float, kept)))


def _more_wrong(base: Base, nominal: Base, grown: Sequence[Ranked], before: Fit,
                data: Data) -> bool:
    """Tell whether effects leave more wrong, at the base's process noise, than its fit before."""
    extended = replace(extended_base(base, nominal, grown), level=base.level)
    _, after = settle(extended, data.windows, data.noise)
    # Misfits below an allowance count alike.
    left = [np.maximum(misfit(fit.residual, data.noise, data.allowed), WRONG)
            for fit in (before, after)]
    return bool(np.sum(np.log(left[1])) > np.sum(np.log(left[0])))
