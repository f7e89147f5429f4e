"""Diagnosis and calibration of an arm whose parts the robot file tells exactly."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot import Tolerances
from flex_plant_sim.commissioning.calibration import calibrate
from flex_plant_sim.diagnosis.likelihood.prior import part_priors
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.logs.log import Log
import pytest
from simulated_records import effects, REFERENCE, simulated
from test_causes import searched

EXACT = replace(REFERENCE, tolerances=Tolerances(**dict.fromkeys(vars(Tolerances()), 0.0)))
FRICTION = 'coulomb_friction:joint_2:level=0.4'


@pytest.mark.parametrize('hidden', [(), (FRICTION,)], ids=['clean', 'friction'])
def test_a_diagnosis_with_known_parts_finds_what_there_is(hidden: tuple[str, ...]) -> None:
    assert not part_priors(EXACT, 0.1)
    found, _ = searched(hidden, base=BaseModel(EXACT),
                        asked=('coulomb_friction', 'viscous_friction'))
    best = found.posterior.best
    assert [h.label for h in best.hypotheses] == ['coulomb_friction:joint_2' for _ in hidden]
    assert best.values.tolist() == pytest.approx([0.4 for _ in hidden], rel=0.05)


def test_known_parts_are_left_as_they_are_by_a_calibration() -> None:
    record = simulated(effects(), 22.0)
    log = Log('log', record.time, record.command, record.output[:, :2], record.output[:, 2:],
              EXACT.gauge_names)
    found = calibrate([log], EXACT, record.payload)
    assert not found.parts
    assert replace(found.robot, effects=()) == replace(EXACT, effects=())
