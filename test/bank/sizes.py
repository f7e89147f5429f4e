"""Sizes against detection limits: hidden effects are large enough to be found, distractors not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
import json
import math
from pathlib import Path
from typing import Any

from bank.cases import BankCase, MODEL_OPTIONS, possible, SIZES
from bank.terms import hidden_terms, Term
from flex_plant_sim.effects import catalogue
import numpy as np
from truth.records import add_effect, TruthCase

# A distractor is at most half a detection limit, and half of the smallest size that matters by the
# catalogue; limits are those of the form that is easiest to see. Four times the truth's clear size
# is still plausible for an arm of this make.
DISTRACTOR_LIMIT, DISTRACTOR_SEVERITY, DISTRACTORS = 0.5, 0.2, 2
SEVERITIES = (1e-3, 4.0)
HALVINGS = 20
DISTRACTED = ('one', 'clean', 'pair')
LIMITS_FILE = Path(__file__).with_name('limits.json')
# No distractors: effects that nature always has, and one that changes the payload, on which others
# depend.
NO_DISTRACTORS = (*MODEL_OPTIONS, 'payload_mass')
# At most one of these is a distractor: two small ones in a joint add up to one that is found.
DRY = frozenset({'coulomb_friction', 'asymmetric_friction', 'stribeck_friction',
                 'presliding_friction'})


@dataclass(frozen=True)
class Limits:
    """
    Detection limits of a robot's clean record, 'identifier:site' to a size.

    Attributes
    ----------
    value, easiest : Mapping
        Of the form that is hardest to see, and of that which is easiest.

    """

    value: Mapping[str, float]
    easiest: Mapping[str, float]


def sized_truth(case: BankCase, limits: Limits) -> tuple[TruthCase, tuple[Term, ...]]:
    """
    Return the case's truth, sized by the limits, and its hidden effects in the catalogue's terms.

    Parameters
    ----------
    case : BankCase
        The case.
    limits : Limits
        Of a clean record of the same robot.

    """
    truth, terms = _at(case, severity_of(case, limits))
    if case.kind in DISTRACTED:
        truth = with_distractors(truth, limits)
    return truth, terms


def severity_of(case: BankCase, limits: Limits) -> float:
    """
    Return the severity at which the smallest hidden effect is as large as the case says.

    It is found by bisection of its logarithm: sizes grow with severity, each in its own way. Where
    no limit is known, the truth's clear size stands for four of them.
    """
    if not case.size:
        return 1.0
    if _least(case, 1.0, limits) is None:
        return case.size / SIZES[0]
    low, high = np.log(SEVERITIES)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        small = (_least(case, float(np.exp(middle)), limits) or 0.0) < case.size
        low, high = (middle, high) if small else (low, middle)
    return float(np.exp(high))


def can_show(case: BankCase, limits: Limits) -> bool:
    """
    Return whether a record of the robot can show what a case hides.

    An effect that shows at no size on a clean record has no detection limit to be sized by. An
    effect that the told model leaves out has its own size, and needs no limit.
    """
    if not case.size or set(case.names) & set(MODEL_OPTIONS):
        return True
    return _least(case, 1.0, limits) is not None


def _least(case: BankCase, severity: float, limits: Limits) -> float | None:
    """Return the smallest size in limits at a severity; None where no limit is known."""
    ratios = [relative_size(term, limits.value) for term in _at(case, severity)[1]]
    return min((ratio for ratio in ratios if ratio is not None), default=None)


def _at(case: BankCase, severity: float) -> tuple[TruthCase, tuple[Term, ...]]:
    truth = case.truth(severity)
    return truth, () if case.kind == 'control' else hidden_terms(truth)


def read_limits() -> dict[str, Limits]:
    """Return the detection limits of each robot, as `run_bank.py --limits` keeps them."""
    found = json.loads(LIMITS_FILE.read_text(encoding='utf-8'))
    return {robot: Limits(**of_robot) for robot, of_robot in found.items()}


def write_limits(answers: Mapping[str, Mapping[str, Any]]) -> None:
    """Write the limits in the tool's answers, by robot, to clean nominal records."""
    kept = {robot: asdict(Limits(**{
        form.name: {label: float(f'{limit[form.name]:.3g}')
                    for label, limit in sorted(answer['detection_limits'].items())}
        for form in fields(Limits)})) for robot, answer in answers.items()}
    LIMITS_FILE.write_text(json.dumps(kept, indent=1) + '\n', encoding='utf-8')


def relative_size(term: Term, limits: Mapping[str, float]) -> float | None:
    """
    Return an effect's size over its detection limit; None where either is unknown.

    Where the limit at its own site is unknown, that at the name's hardest site stands for it.
    """
    known = [limit for label, limit in limits.items() if label.partition(':')[0] == term.name]
    limit = limits.get(f'{term.name}:{term.site}', max(known, default=0.0))
    if not limit > 0.0 or math.isnan(term.size):
        return None
    return float(term.size / limit)


def over_threshold(term: Term, limits: Limits) -> float:
    """
    Return a size over the detection limit or the smallest that matters, whichever is less.

    Dry friction that is too small for its own name may still show under a simpler one's.
    """
    smallest = min(parameter.smallest for parameter in catalogue()[term.name].parameters)
    names = DRY if term.name in DRY else {term.name}
    ratios = [relative_size(replace(term, name=name), limits.easiest) or 0.0 for name in names]
    return max(*ratios, term.size / smallest)


def with_distractors(truth: TruthCase, limits: Limits) -> TruthCase:
    """Return the truth with further effects, each too small to be found."""
    others = [name for name in possible(truth.robot)
              if name not in (*truth.names, *NO_DISTRACTORS)]
    chosen = np.random.default_rng([truth.seed, 17]).choice(others, DISTRACTORS, replace=False)
    for number, name in enumerate(map(str, chosen)):
        if name in DRY and DRY & set(truth.names):
            continue
        severity = DISTRACTOR_SEVERITY
        trial = _added(truth, name, number, severity)
        # Scaled twice, because not every size is proportional to its severity.
        for _ in range(2):
            ratio = over_threshold(hidden_terms(trial)[-1], limits)
            if ratio > DISTRACTOR_LIMIT:
                severity *= DISTRACTOR_LIMIT / ratio
                trial = _added(truth, name, number, severity)
        truth = trial
    return truth


def _added(truth: TruthCase, name: str, number: int, severity: float) -> TruthCase:
    return add_effect(truth, name, np.random.default_rng([truth.seed, number, 18]), severity)
