"""Sizes against detection limits: what is hidden is fair to ask for, distractors are not."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any

from bank.cases import BankCase, MODEL_OPTIONS
from bank.terms import hidden_terms, Term
from flex_plant_sim.effects import catalogue
import numpy as np
from truth.effects import CATALOGUE
from truth.records import add_effect, TruthCase

# What is hidden is at least so many detection limits in size; a distractor at most half a limit,
# and half of what the catalogue calls the smallest size that matters.
TIMES_LIMIT, DISTRACTOR_LIMIT = 3.0, 0.5
LARGEST_SEVERITY, DISTRACTOR_SEVERITY = 4.0, 0.2
DISTRACTORS = 2
SIZED = ('one', 'missing', 'pair')
DISTRACTED = ('one', 'clean', 'pair')
# Not as distractors: what is in nature always, and what changes the payload that others count on.
NO_DISTRACTORS = (*MODEL_OPTIONS, 'payload_mass')

Limits = Mapping[str, float]


def sized_truth(case: BankCase, limits: Limits) -> tuple[TruthCase, tuple[Term, ...]]:
    """
    Return the case's truth, sized by the limits, and what it hides in the catalogue's terms.

    Parameters
    ----------
    case : BankCase
        What to hide.
    limits : Mapping
        'identifier:site' to the detection limit of a clean record of the same robot.

    """
    truth, terms = _at(case, 1.0)
    if case.kind in SIZED:
        ratios = [relative_size(term, limits) for term in terms]
        known = [ratio for ratio in ratios if ratio]
        if known and min(known) < TIMES_LIMIT:
            severity = min(1.02 * TIMES_LIMIT / min(known), LARGEST_SEVERITY)
            truth, terms = _at(case, severity)
    if case.kind in DISTRACTED:
        truth = with_distractors(truth, limits)
    return truth, terms


def _at(case: BankCase, severity: float) -> tuple[TruthCase, tuple[Term, ...]]:
    truth = case.truth(severity)
    return truth, () if case.kind == 'control' else hidden_terms(truth)


def stated_limits(line: Mapping[str, Any]) -> dict[str, float]:
    """Return the limits in the line of results of a clean record."""
    return {label: limit['value'] for label, limit in line['limits'].items()
            if limit['value'] is not None}


def relative_size(term: Term, limits: Limits) -> float | None:
    """Return an effect's size over its detection limit; None where either is unknown."""
    limit = limits.get(f'{term.name}:{term.site}')
    if limit is None or not limit > 0.0 or math.isnan(term.size):
        return None
    return float(term.size / limit)


def over_threshold(term: Term, limits: Limits) -> float:
    """Return a size over the detection limit or the smallest that matters, whichever is less."""
    smallest = min(parameter.smallest for parameter in catalogue()[term.name].parameters)
    return max(relative_size(term, limits) or 0.0, term.size / smallest)


def with_distractors(truth: TruthCase, limits: Limits) -> TruthCase:
    """Return the truth with further effects, each too small to be found."""
    others = [name for name in CATALOGUE if name not in (*truth.names, *NO_DISTRACTORS)]
    chosen = np.random.default_rng([truth.seed, 17]).choice(others, DISTRACTORS, replace=False)
    for number, name in enumerate(map(str, chosen)):
        severity = DISTRACTOR_SEVERITY
        trial = _added(truth, name, number, severity)
        ratio = over_threshold(hidden_terms(trial)[-1], limits)
        if ratio > DISTRACTOR_LIMIT:
            trial = _added(truth, name, number, severity * DISTRACTOR_LIMIT / ratio)
        truth = trial
    return truth


def _added(truth: TruthCase, name: str, number: int, severity: float) -> TruthCase:
    return add_effect(truth, name, np.random.default_rng([truth.seed, number, 18]), severity)
