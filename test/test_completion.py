"""What the locked part and latent forces say, for whoever calls the diagnosis from Python."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.verdict.completion import complete, Completed
from flex_plant_sim.diagnosis.verdict.locked_part import PREDICTS_WORSE
from flex_plant_sim.logs.log import Log
import pytest
from simulated_records import effects, REFERENCE, simulated, SLOWEST
from test_diagnose_report import report

FRICTION = effects('viscous_friction:joint_2:damping_n_m_s=2')


def completed(true: bool, told: list[str]) -> Completed:
    """Return the diagnosis of friction, which the arm has or has not, completed."""
    record = simulated(FRICTION if true else (), 24.0)
    data = Data.of([record], SLOWEST, REFERENCE.sample_time)
    named = replace(report().diagnosis, cannot_tell=(), sets=(
        (('viscous_friction:joint_2',), 0.97), (('unknown',), 0.02), ((), 0.01)))
    log = Log('arm.csv', record.time, record.command, record.output[:, :2], record.output[:, 2:],
              REFERENCE.gauge_names, notes=('a note',))
    return complete((named, data, BaseModel(REFERENCE, effects=FRICTION)), BaseModel(REFERENCE),
                    progress=lambda step, share: told.append(step), logs=[log])


@pytest.mark.parametrize('true', [True, False])
def test_a_python_caller_gets_the_verdict_that_the_locked_part_leaves(true: bool) -> None:
    told: list[str] = []
    found = completed(true, told)
    diagnosis = found.diagnosis
    assert (diagnosis.verdict == 'cause') == true
    assert (PREDICTS_WORSE in diagnosis.sentence) != true
    assert (diagnosis.causes[0].probability == report().diagnosis.causes[0].probability) == true
    # What is refuted is unnamed, and the forces that remain are then shown.
    assert set(found.latent) == ({'before'} if true else {'before', 'after'})
    assert (dict(diagnosis.sets)['unknown',] > 0.2) != true
    assert sum(p for _, p in diagnosis.sets) == pytest.approx(1.0)
    assert told == ['latent forces', 'measuring the gain']
    assert [hint.text for hint in diagnosis.hints] == ['a note']
    errors = [gain.after < gain.before for gain in found.gains if gain.channel == 'joint_2']
    assert all(errors) if true else not any(errors)
