"""The default estimator on an arm whose parts the robot file tells exactly: tolerances of zero."""

from __future__ import annotations

from dataclasses import replace

from flex_payload_estimator.estimators.rpe.time_update import MASS
from flex_plant_sim.arm.parts import robot_parts
from flex_plant_sim.arm.robot import Tolerances
from flex_plant_sim.simulation.payload_profile import PayloadProfile
import numpy as np
import pytest
from rpe_runs import estimator_of, robot_with, Run

EXACT = Tolerances(**dict.fromkeys(vars(Tolerances()), 0.0))
# Known parts of the motion beside gauges, payload and lengths that are not.
SENSORS = replace(EXACT, strain_gain=0.01, strain_bias=2e-5, payload=0.05, length=0.005)


@pytest.mark.parametrize('tolerances', [EXACT, SENSORS])
def test_known_parts_leave_the_payload_to_be_estimated(tolerances: Tolerances) -> None:
    robot = replace(robot_with(2e-4), tolerances=tolerances)
    estimator = estimator_of(robot)
    run = Run(estimator, PayloadProfile((4.0, 4.0), (0.1, 0.25)), 8.0, seed=3)
    for k in (300, 800):
        assert run.estimates[k].status == 'ok'
        assert abs(run.mass[k] - run.truth[k]) < 3.0 * run.std[k]
        assert run.std[k] < 0.01


def test_a_model_about_other_parameters_has_no_slopes_over_known_parts() -> None:
    robot = replace(robot_with(), tolerances=EXACT)
    assert not robot_parts(robot)
    stepper = estimator_of(robot).stepper
    reference = stepper.prior.mean.copy()
    reference[MASS] = 0.2
    model, known = stepper.lineariser.model_about(reference), stepper.schedule
    assert model.parts_at(0.3).size == known.parts_at(0.2, 0.3).size == 0
    np.testing.assert_allclose(model.series[:, :5], known.cut(0.2).series[:, :5], atol=1e-5)
