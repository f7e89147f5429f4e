"""The default estimator's first seconds in motion, on arms whose parts are all a little off."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_plant_sim.arm.robot_file import load_robot
import numpy as np
import pytest
from truth.records import draw_case, make_record


@pytest.mark.parametrize('seed', [111, 114, 117])
def test_free_parts_that_exact_models_lead_at_first_keep_every_payload(seed: int) -> None:
    """Finite elements; given up but for one payload, they were 27 to 53 % off at 2 s."""
    case = draw_case(None, seed, 'quanser_2dsfl', duration_s=2.05)
    record, command = make_record(case), np.zeros(2)
    estimator = RecursivePredictionError(load_robot('quanser_2dsfl'))
    for time, joint, strain, after in zip(record.time.tolist(), record.joint, record.strain,
                                          record.command):
        found = estimator.update(time, np.r_[joint, strain], command)
        command = after
    assert abs(found.mass - case.payload_true) < 2.0 * found.variance**0.5
    assert found.variance**0.5 < 0.1 * case.payload_true and found.status == 'ok'


def test_free_parts_learn_no_more_than_the_first_samples_hold() -> None:
    """Finite elements; linearised about moving estimates, one was 92 % off by 7 %, `ok`."""
    case = draw_case(None, 83028, 'quanser_2dsfl', duration_s=1.05)
    record, command = make_record(case), np.zeros(2)
    estimator = RecursivePredictionError(load_robot('quanser_2dsfl'))
    for time, joint, strain, after in zip(record.time.tolist(), record.joint, record.strain,
                                          record.command):
        found = estimator.update(time, np.r_[joint, strain], command)
        command = after
        assert found.status != 'ok' \
            or abs(found.mass - case.payload_true) < 3.0 * found.variance**0.5
    assert abs(found.mass - case.payload_true) < 0.05 * case.payload_true
