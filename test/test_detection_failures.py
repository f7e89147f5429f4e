"""Detection limits where information is steep, none, or not finite."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

from flex_plant_sim.arm.state_space import zero_order_hold
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses
from flex_plant_sim.diagnosis.causes.proposal import Proposal
from flex_plant_sim.diagnosis.likelihood.evidence import detectable_size
from flex_plant_sim.diagnosis.likelihood.prior import log_prior_odds
from flex_plant_sim.diagnosis.verdict import detection
from flex_plant_sim.diagnosis.verdict.detection import CLOSE, detection_limits, visible_size
from flex_plant_sim.diagnosis.verdict.results import DetectionLimit
import numpy as np
import pytest
from scipy.optimize import brentq
from simulated_records import REFERENCE


class OneProposal:
    """As much of a proposal as a limit asks for."""

    def __init__(self, label: str):
        self.hypothesis = next(h for h in all_hypotheses(REFERENCE) if h.label == label)


def test_a_limit_that_fails_leaves_the_others_where_they_are(
        monkeypatch: pytest.MonkeyPatch) -> None:
    # Those that fail were dropped, and each later hypothesis got the limit of the next one.
    labels = ('viscous_friction:joint_1', 'viscous_friction:joint_2', 'strain_gain:strain_1a')

    def limits(proposal: OneProposal, **_: object) -> list[float]:
        place = labels.index(proposal.hypothesis.label)
        if place == 1:
            zero_order_hold(np.full((2, 2), np.nan), np.zeros((2, 1)), 0.01)
        return [float(place)]

    monkeypatch.setattr(detection, '_limits', limits)
    proposals = cast(list[Proposal], [OneProposal(label) for label in labels])
    shares: list[float] = []
    found = detection_limits(proposals, REFERENCE, 40.0, lambda *_: 0.0, progress=shares.append)
    assert shares == pytest.approx([1.0 / 3.0, 2.0 / 3.0, 1.0])
    assert [found[label].value for label in labels] == [0.0, np.inf, 2.0]


def test_a_limit_has_the_size_of_the_hardest_and_of_the_easiest_form(
        monkeypatch: pytest.MonkeyPatch) -> None:
    forms = [h for h in all_hypotheses(REFERENCE) if h.label == 'gear_compliance:joint_1']
    assert len(forms) == 2
    sizes = dict(zip(forms, (0.0004, 0.0017)))
    monkeypatch.setattr(detection, '_limits', lambda proposal, **_: [sizes[proposal.hypothesis]])
    proposals = cast(list[Proposal], [SimpleNamespace(hypothesis=form) for form in forms])
    found = detection_limits(proposals, REFERENCE, 40.0, lambda *_: 0.0)
    assert found == {forms[0].label: DetectionLimit(0.0017, 'rad/(N m)', 0.0004)}


@pytest.mark.parametrize('guess', [0.01, 0.5, 1.2, 30.0])
def test_a_limit_is_where_the_evidence_turns_however_steeply_information_rises(guess: float
                                                                               ) -> None:
    """Of a clean bench record (case_8009d8b8), whose commands reach 0.857: said was 0.012."""
    saturation, = (h for h in all_hypotheses(REFERENCE)
                   if h.label == 'actuator_saturation:joint_1')
    sizes = np.log([1.14, 1.18, 1.22, 1.3, 1.7, 2.8, 5.0])
    information = np.log([1e-9, 1.1e-4, 2.35, 39.9, 344.5, 390.6, 171.3])
    # One-sided, so the prior is twice as dense.
    price = -log_prior_odds(saturation.effect, REFERENCE) - np.log(2.0)

    def needed(size: float) -> float:
        known = np.exp(np.interp(np.log(size), sizes, information))
        return detectable_size(float(known), float(saturation.prior(40.0).width[0]), price)

    found = visible_size(needed, guess, 100.0)
    turns = brentq(lambda size: needed(size) - size, 1.22, 1.3)
    assert needed(found) <= found and turns <= found < (1.0 + CLOSE) * turns


def test_no_limit_is_stated_where_no_size_shows() -> None:
    assert visible_size(lambda size: 2.0 * size, 0.1, 50.0) == np.inf
    assert visible_size(lambda size: np.inf, 0.1, 50.0) == np.inf
    assert visible_size(lambda size: 3.0, 0.1, 2.0) == np.inf
    assert visible_size(lambda size: 3.0, 0.1, 4.0) == pytest.approx(3.0)
    assert visible_size(lambda size: 0.5 * size, 0.1, 4.0, 0.02) == 0.02
