"""The recursive-prediction-error estimator on an arm with a gap, which no part of it has."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_plant_sim.arm.robot_file import load_robot
import numpy as np
from truth.records import make_record, TruthCase


def test_coarse_finds_its_way_back_from_where_a_wrong_model_has_led() -> None:
    """Finite elements, encoder on the motor; 72 % off, 15 deviations, without a new start."""
    gap = ('backlash', {'joint': 1, 'gap': 0.01885})
    case = TruthCase(111, (gap,), duration_s=10.05, payload_true=0.0706, payload_told=0.0706,
                     forms=('sensor_on_motor',))
    record = make_record(case)
    estimator, command = RecursivePredictionError(load_robot('reference')), np.zeros(2)
    for time, joint, strain, after in zip(record.time[:502], record.joint, record.strain,
                                          record.command):
        found = estimator.update(float(time), np.r_[joint, strain], command)
        command = after
    assert estimator.incumbent.mode.name == 'coarse' and estimator.incumbent.passes > 0
    assert abs(found.mass - case.payload_true) < 1.96 * found.variance**0.5
    assert found.variance**0.5 < 0.5 * case.payload_true
