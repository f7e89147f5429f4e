"""The payload estimate before and after: the extended model helps, and tells nothing away."""

from __future__ import annotations

from flex_payload_estimator.tools.diagnose import default_estimator
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.report.payload_gain import payload_gain, Weigh
from flex_plant_sim.logs.log import Log
import pytest
from simulated_records import effects, REFERENCE, simulated

TRUE = REFERENCE.payload_mass


@pytest.fixture(scope='module')
def estimator() -> tuple[str, Weigh]:
    """Return the default estimator, which weighs a log once with each model that it is told."""
    name, weigh = default_estimator()
    known: list[tuple[Log, BaseModel, tuple[float, float]]] = []

    def weigh_once(log: Log, told: BaseModel) -> tuple[float, float]:
        for other, model, answer in known:
            if other is log and model == told:
                return answer
        known.append((log, told, weigh(log, told)))
        return known[-1][2]

    return name, weigh_once


@pytest.fixture(scope='module')
def log() -> Log:
    """Return the log of an arm whose payload is bulky."""
    record = simulated(effects('payload_inertia:arm:inertia_kg_m2=0.006'), 8.0)
    return Log('made.csv', record.time, record.command, record.output[:, :2],
               record.output[:, 2:], REFERENCE.gauge_names)


def test_the_right_effect_brings_the_payload_right(
        log: Log, estimator: tuple[str, Weigh]) -> None:
    right = BaseModel(REFERENCE, effects=effects('payload_inertia:arm:inertia_kg_m2=0.006'))
    row, = payload_gain([log], TRUE, BaseModel(REFERENCE), right, *estimator)
    assert abs(row.after_percent) < 2.0
    assert abs(row.after_percent) < 0.5 * abs(row.before_percent)
    found = row.results()
    assert found['before_kg'] == row.before and found['true_kg'] == TRUE
    assert found['after_percent'] == pytest.approx(100.0 * (row.after / TRUE - 1.0))


def test_a_payload_that_was_found_is_not_told_to_the_estimator(
        log: Log, estimator: tuple[str, Weigh]) -> None:
    told = BaseModel(REFERENCE, effects=effects('payload_mass:arm:deviation_kg=0.05'))
    row, = payload_gain([log], TRUE, BaseModel(REFERENCE), told, *estimator)
    assert (row.after, row.after_std) == (row.before, row.before_std)
