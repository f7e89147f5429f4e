"""A cause that stood in for another, found out once the other causes are known."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.diagnosis.held_out.candidate_pass import Data, one_pass, Round
from flex_plant_sim.diagnosis.held_out.exchange import exchanged, refitted
from flex_plant_sim.diagnosis.held_out.fit import settle
from flex_plant_sim.diagnosis.held_out.hypothesis import hypotheses, Hypothesis
from flex_plant_sim.diagnosis.held_out.ranking import Ranked
from flex_plant_sim.diagnosis.held_out.verdict import cause_of
from flex_plant_sim.diagnosis.prediction.predictor import Base
import pytest
from simulated_records import effects, REFERENCE, simulated

FRICTION, LOOK_ALIKE, GAUGE = (
    'viscous_friction:joint_2', 'actuator_gain:joint_2', 'strain_gain:strain_2a')
HIDDEN = effects(f'{FRICTION}:damping_n_m_s=3', f'{GAUGE}:factor=0.8')
NOMINAL = Base(REFERENCE)


def named(*labels: str) -> list[Hypothesis]:
    """Return hypotheses named as identifier:site."""
    return [h for h in hypotheses(REFERENCE) if h.label in labels]


def greedy(data: Data) -> tuple[list[Ranked], dict[Hypothesis, Round]]:
    """Return the look-alike and the gauge, each chosen while the other was missing."""
    problem, fitted = settle(NOMINAL, data.windows, data.noise)
    found = one_pass(problem, fitted, named(FRICTION, LOOK_ALIKE, GAUGE), data, 1)
    accepted = [r for r in found.ranked if r.hypothesis.label in (LOOK_ALIKE, GAUGE)]
    return ([refitted(problem, r, fitted, data) for r in accepted],
            {r.hypothesis: replace(found, chosen=r) for r in accepted})


def test_what_stood_in_for_a_cause_is_exchanged_beside_the_others() -> None:
    data = Data.of([simulated(HIDDEN, 28.0)], NOMINAL)
    accepted, grounds = greedy(data)
    kept, told = exchanged(NOMINAL, NOMINAL, accepted, grounds, data, 1)
    sizes = {r.hypothesis.label: float(r.fit.values[0]) for r in kept}
    assert sizes == {FRICTION: pytest.approx(3.0, rel=0.05), GAUGE: pytest.approx(0.8, rel=0.05)}
    # What is said of a cause comes from the ranking beside the other one, not from its own round.
    for ranked in kept:
        ground = told[ranked.hypothesis]
        assert ground.chosen is not None and ground.chosen.hypothesis == ranked.hypothesis
        assert all(ground is not first for first in grounds.values())
        cause = cause_of(ranked, ground)
        assert cause.probability > 0.9 and not cause.look_alikes
