"""What was learnt about a wrong point is learnt again, as long as the samples are kept."""

from __future__ import annotations

from dataclasses import replace

from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_payload_estimator.estimators.rpe.filter import Filter
from flex_payload_estimator.estimators.rpe.window_pass import gauss_newton_pass
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.interval import Z95
import numpy as np
import pytest
from truth.records import build_arm, draw_case, make_record, Record
from truth.tolerances import TOLD

ROBOT = 'quanser_2dsfl'


def rows(record: Record) -> list[tuple[float, Array, Array]]:
    """Return time, outputs and the command applied up to it, for each sample."""
    before = np.vstack([np.zeros((1, 2)), record.command[:-1]])
    return list(zip(record.time.tolist(), np.column_stack([record.joint, record.strain]), before))


def converged(estimator: RecursivePredictionError, passes: int = 6) -> Filter:
    """Return what passes over all that the window holds end at."""
    window, f = estimator._competition.window, estimator.incumbent
    for _ in range(passes):
        again = gauss_newton_pass(f, window, estimator.stepper)
        assert again is not None
        while not again.advance(window, estimator.stepper):
            pass
        f = again.best.kalman
    return f


def test_it_has_converged_on_a_gently_moved_arm_it_does_not_model() -> None:
    """Three passes in the first 1.2 s ended three deviations away, and stayed there."""
    case = replace(draw_case(None, 1200003, ROBOT, duration_s=12.0, excitation='gentle'),
                   spread=TOLD)
    estimator = RecursivePredictionError(load_robot(ROBOT), 'assumed_modes', 3)
    for row in rows(make_record(case)):
        found = estimator.update(*row)
    std = found.variance**0.5
    assert estimator.incumbent.mass == pytest.approx(converged(estimator).mass, abs=0.3 * std)
    assert found.mass == pytest.approx(build_arm(case).payload.mass, abs=Z95 * std)
