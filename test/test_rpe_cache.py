"""What rpe keeps of a model: the last results, by their key."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.effects import CACHED_ARMS, EffectStep
from flex_payload_estimator.estimators.rpe.modes import EXACT
from flex_payload_estimator.estimators.rpe.schedule import BoundedCache
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np
import pytest
from rpe_runs import estimator_of
from simulated_records import effects, REFERENCE


def test_the_oldest_result_makes_room_and_no_other() -> None:
    cache, made = BoundedCache(3), []
    for key in (0, 1, 2, 0, 3, 1, 2, 0):
        def make(of: int = key) -> int:
            made.append(of)
            return 10 + of
        assert cache.get(key, make) == 10 + key
    assert made == [0, 1, 2, 3, 0]


def test_one_payload_too_many_leaves_the_other_loaded_arms(monkeypatch: pytest.MonkeyPatch
                                                           ) -> None:
    """All were forgotten, and each built again."""
    step = EffectStep(ExtendedArm(REFERENCE, 'assumed_modes', 2, effects=effects(
        'joint_spring:joint_2:stiffness_n_m_per_rad=0.1,rest_rad=0')))
    f = estimator_of().stepper.begin(EXACT, np.zeros(6), 0.1, 0.1)
    loaded, at_payload = [], ExtendedArm.at_payload

    def counted(arm: ExtendedArm, payload: float) -> ExtendedArm:
        loaded.append(payload)
        return at_payload(arm, payload)
    monkeypatch.setattr(ExtendedArm, 'at_payload', counted)
    masses = [0.01 * k for k in range(CACHED_ARMS + 1)]
    for mass in [*masses, *masses[1:]]:
        step.push(f, mass, np.zeros(step.arm.states), np.zeros(2), 0.0)
    assert loaded == masses
