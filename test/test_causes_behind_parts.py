"""A cause that the parts imitate while another one is named."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from flex_plant_sim.diagnosis.causes import search
from flex_plant_sim.diagnosis.causes.posterior import SetKey
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
import numpy as np
import pytest
from simulated_records import REFERENCE, SLOWEST
from test_causes import searched
from truth.records import make_record, TruthCase

RIPPLE = ('torque_ripple', {'joint': 1, 'order': 38.65, 'phase': 6.05, 'torque': 4.85})
BULKY = ('payload_inertia', {'inertia': 0.00576})
PAYLOAD = 0.061


def test_a_cause_is_found_behind_parts_that_are_far_off_beside_a_named_one() -> None:
    # Beside the ripple the parts are 18 tolerances off. Linearised there the payload's inertia
    # gains nothing, and gauges that are said to be wrong make up for the rest.
    truth = make_record(TruthCase(12902, (RIPPLE, BULKY), duration_s=18.0, payload_true=PAYLOAD))
    record = Record('truth', truth.time, truth.command, np.hstack([truth.joint, truth.strain]),
                    PAYLOAD)
    found, _ = searched((), Data.of([record], SLOWEST, REFERENCE.sample_time),
                        ('torque_ripple', 'payload_inertia'))
    assert SetKey.of(found.best.fit).labels == {'torque_ripple:joint_1', 'payload_inertia:arm'}
    assert not found.best.parts_stand_for_a_cause
    assert abs(found.best.fit.values - np.array([4.72, -1.12, 38.65, 0.00576])).max() < 0.6


@pytest.mark.parametrize(('unnamed', 'centre_off', 'best_off', 'hide'), [
    (False, True, True, True), (False, True, False, False), (False, False, True, False),
    # On the measured record it ended in an error: that set was never fitted without its remainder.
    (True, True, True, False)])
def test_parts_hide_a_cause_where_nothing_else_explains_them(
        unnamed: bool, centre_off: bool, best_off: bool, hide: bool) -> None:
    discrepancy = DiscrepancyModel(remainder=unnamed)
    centre: Any = SimpleNamespace(fit=SimpleNamespace(discrepancy=discrepancy),
                                  parts_stand_for_a_cause=centre_off)
    state: Any = SimpleNamespace(nominal=BaseModel(REFERENCE),
                                 best=SimpleNamespace(parts_stand_for_a_cause=best_off))
    assert search._parts_hide_a_cause(state, centre) is hide
