"""Detection limits where the sizes that are tried predict nothing finite."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

from flex_plant_sim.arm.state_space import zero_order_hold
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses
from flex_plant_sim.diagnosis.causes.proposal import Proposal
from flex_plant_sim.diagnosis.verdict import detection
from flex_plant_sim.diagnosis.verdict.detection import detection_limits
from flex_plant_sim.diagnosis.verdict.results import DetectionLimit
import numpy as np
import pytest
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
