"""A heavy arm that bends by a third of its length: in a loop, on finite elements."""

from __future__ import annotations

from flex_payload_estimator.control.lqg import LQGController, LQGSettings
from flex_payload_estimator.control.set_points import square
from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_plant_sim.arm.parts import drawn
from flex_plant_sim.arm.robot_file import load_robot
import numpy as np
from sampled_arm import Elements, elements_of

PAYLOAD, SEED = 0.3, 717004


def test_a_model_that_fails_in_motion_is_not_sure_of_another_payload_at_rest() -> None:
    # `coarse` takes over in the quiet end of the fourth step, 14 s. About its moving estimate it
    # fell to 0.000 +- 0.016 kg within a second.
    robot = load_robot('reference')
    arm = elements_of(drawn(robot, np.random.default_rng([SEED, 3])), PAYLOAD)
    plant, target = Elements(arm, robot, SEED), square(period=8.0)
    controller = LQGController(robot, 'assumed_modes', 2, LQGSettings(mass_0=0.0))
    estimator = make_estimator('rpe', robot, 'assumed_modes', 3)
    assert isinstance(estimator, RecursivePredictionError)
    sent, deviations, modes = np.zeros(2), [], set()
    for k in range(1580):
        time, output = k * robot.sample_time, plant.measure()
        found = estimator.update(time, output, sent)
        if time > 1.0:
            deviations.append((found.mass - PAYLOAD) / np.sqrt(found.variance))
            modes.add(estimator.incumbent.mode.name)
        sent = controller.command(time, output, sent, found.mass, target(time))
        plant.step(sent)
    assert 'coarse' in modes
    assert np.abs(deviations).max() < 3.0
