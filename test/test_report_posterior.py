"""The posterior in the report: sets of causes, and parts that moved, with prior and posterior."""

from __future__ import annotations

from flex_plant_sim.diagnosis.report.html_report import render, Report
from flex_plant_sim.diagnosis.report.posterior_pictures import moved, sets_picture
from flex_plant_sim.diagnosis.verdict.results import Diagnosis, PartEstimate
from flex_plant_sim.diagnosis.verdict.symptoms import ChannelResidual, Whiteness
from flex_plant_sim.diagnosis.verdict.wording import part_text
import pytest

FAR = PartEstimate('shoulder drive damping', '', 0.05, -0.08, 0.01)
NEAR = PartEstimate('payload mass', '', 0.01, 0.004, 0.008)
BIASED = PartEstimate('strain_1a bias', 'm/m', 2e-6, 5e-6, 1e-7)
SETS = ((('coulomb_friction:joint_2', 'payload_mass:arm'), 0.7), (('unknown',), 0.2), ((), 0.1))


def test_parts_beyond_their_tolerance_come_furthest_first() -> None:
    assert moved((NEAR, FAR, BIASED)) == [BIASED, FAR]


@pytest.mark.parametrize(('part', 'text'), [
    (FAR, 'shoulder drive damping -7.69 ± 2 % (tolerance 5 %)'),
    (PartEstimate('damping_1', '', 1.0, 4.9, 0.13),
     'damping 1 times 130 (100 to 170) (tolerance 100 %)'),
    (BIASED, 'strain 1a bias +5 ± 0.2 µm/m (tolerance 2 µm/m)')])
def test_part_says_prior_and_posterior(part: PartEstimate, text: str) -> None:
    assert part_text(part) == text


def test_sets_are_named_with_their_probabilities() -> None:
    assert sets_picture(SETS).text == (
        'coulomb friction, joint 2 + payload mass 70 %; unknown 20 %; nothing wrong 10 %')


def test_report_shows_both() -> None:
    white = Whiteness(1.0, 20, 0.5, 0.0)
    channel = ChannelResidual('joint_1', 'rad', 1e-4, 0.3, {0.01: 1e-4}, white, {'angle': 0.0},
                              {'angle': 0.0}, ((0.0, 50.0, 1.0, 1.0),))
    diagnosis = Diagnosis('cause', 'Something.', parts=(NEAR, FAR), sets=SETS)
    page = render(Report(diagnosis, (channel,), (channel,), ()))
    assert 'shoulder drive damping -7.69 ± 2 % (tolerance 5 %)' in page
    assert 'unknown 20 %' in page and page.count('data:image/svg+xml') == 2
