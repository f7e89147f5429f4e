"""The recursive-prediction-error estimator on an arm that something pulls at all the time."""

from __future__ import annotations

from dataclasses import replace

from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
import numpy as np
import pytest
from truth.records import draw_case, HAVE_MUJOCO, make_record, MUJOCO, NO_MUJOCO


def blown(monkeypatch: pytest.MonkeyPatch, force: Array) -> None:
    """Let a force, N in the plane, act at the end of MuJoCo's chain."""
    from truth.mujoco.drives import Surroundings
    alone = Surroundings.act

    def act(self: Surroundings, data: object, *others: float) -> None:
        alone(self, data, *others)  # type: ignore[arg-type]
        data.xfrc_applied[-1, :2] = force  # type: ignore[attr-defined]

    monkeypatch.setattr(Surroundings, 'act', act)


@pytest.mark.skipif(not HAVE_MUJOCO, reason=NO_MUJOCO)
@pytest.mark.parametrize('seed', [12000, 12006])
def test_a_constant_force_at_the_tip_is_found_and_is_no_payload(
        seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """0.2 N; before it was part of the posterior the payload was 20 and 42 % off at 3 s."""
    angle = float(np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi))
    force = 0.2 * np.array([np.cos(angle), np.sin(angle)])
    blown(monkeypatch, force)
    case = replace(draw_case(None, seed, duration_s=3.05), simulator=MUJOCO)
    record = make_record(case)
    estimator, command = RecursivePredictionError(load_robot('reference')), np.zeros(2)
    for time, joint, strain, after in zip(record.time, record.joint, record.strain,
                                          record.command):
        found = estimator.update(float(time), np.r_[joint, strain], command)
        command = after
    assert not estimator.events and found.status == 'ok'
    assert abs(found.mass - case.payload_true) < 1.96 * found.variance**0.5
    assert found.variance**0.5 < 0.05 * case.payload_true
    f, prior = estimator.incumbent, estimator.stepper.prior
    first = f.beta.size - prior.parts - prior.gains
    pull = f.beta[first:first + 2]
    # It shares what it does with the gauges' and the drives' biases.
    assert np.linalg.norm(pull - force) < 0.5 * np.linalg.norm(force)
