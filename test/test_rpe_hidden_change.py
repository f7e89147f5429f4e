"""Changes of the payload on arms whose model is wrong, for the recursive-prediction-error one."""

from __future__ import annotations

from dataclasses import replace

from flex_payload_estimator.estimators.rpe import transitions
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_payload_estimator.estimators.rpe.modes import COARSE, EXACT, Mode, ROUGH
from flex_payload_estimator.estimators.rpe.restarts import PASSES
from flex_payload_estimator.estimators.rpe.trial import Trial
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.simulation.payload_profile import PayloadProfile
import numpy as np
import pytest
from rpe_runs import estimator_of, Run
from truth.records import draw_case, make_record

WITHIN_S = 1.0


@pytest.mark.parametrize(('seed', 'before', 'after'), [(1, 0.17, 0.06), (2, 0.06, 0.2)])
def test_a_change_on_an_arm_with_a_soft_gear_is_told(
        seed: int, before: float, after: float) -> None:
    # Finite elements; a spring of any joint is in no mode.
    soft = draw_case('gear_compliance', seed)
    change = ('payload_change', {'time': 4.0, 'mass': after, 'duration': 0.0})
    record = make_record(replace(soft, duration_s=5.55, payload_true=before, payload_told=before,
                                 effects=(*soft.effects, change)))
    estimator, command, answers = RecursivePredictionError(load_robot('reference')), \
        np.zeros(2), []
    for time, joint, strain, sent in zip(record.time, record.joint, record.strain,
                                         record.command):
        answers.append(estimator.update(float(time), np.r_[joint, strain], command))
        command = sent
    event, = estimator.events
    assert estimator.incumbent.mode.name == 'coarse'
    assert event.time == pytest.approx(4.0, abs=0.2) and event.found < 4.0 + WITHIN_S
    found = answers[-1]
    assert abs(found.mass - after) < 1.96 * found.variance**0.5 < 0.4 * after


@pytest.mark.parametrize(('mode', 'misfit', 'score', 'needed'), [
    (EXACT, 1.0, 0.5, 1.0), (EXACT, 9.0, 3.0, 27.0), (ROUGH, 1.0, 0.1, 1.0),
    (ROUGH, 1.0, 5.0, 20.0),
    (COARSE, 1.0, 0.5, 2.0), (COARSE, 7.0, 0.1, 7.0), (COARSE, 7.0, 5.0, 140.0)])
def test_what_a_change_needs_grows_with_what_the_model_was_wrong_by_before(
        mode: Mode, misfit: float, score: float, needed: float) -> None:
    estimator = estimator_of()
    Run(estimator, PayloadProfile.constant(0.15), 1.2)
    competition, incumbent = estimator._competition, estimator.incumbent.copy()
    incumbent.mode, incumbent.passes = mode, PASSES
    now = competition._situation(incumbent)._replace(trials=[], time_in_motion=9.0)
    for share, wins in ((0.99, False), (1.01, True)):
        trial = Trial('change', incumbent, 0.4, 0.1, misfit, score,
                      log_ratio=share * needed * now.threshold, counted=0.3)
        assert transitions.wins(trial, now) is wins
