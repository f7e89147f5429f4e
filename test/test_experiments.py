"""What one more experiment would settle is said for every effect."""

from __future__ import annotations

from flex_plant_sim.diagnosis.verdict.experiments import experiment
from flex_plant_sim.effects import catalogue
import pytest


@pytest.mark.parametrize('names', [(a, b) for a, b in zip(catalogue(), list(catalogue())[1:])])
def test_every_pair_has_an_experiment(names: tuple[str, str]) -> None:
    text = experiment(names)
    assert text.startswith(f'To tell {names[0].replace("_", " ")} from {names[1]}'[:40]
                           .replace('_', ' ')) and text.endswith('.')


def test_causes_that_show_in_different_records_are_told_which() -> None:
    text = experiment(('coulomb_friction', 'clamp_compliance'))
    assert 'constant speed, both ways (shows coulomb friction)' in text
    assert 'pluck of the tip, with the joints held (shows clamp compliance)' in text
