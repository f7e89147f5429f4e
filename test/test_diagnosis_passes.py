"""A diagnosis takes no pass through a record twice, nor one that nothing reads."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.gauss_newton import GaussNewton
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses, CauseSet, Hypothesis
from flex_plant_sim.diagnosis.causes.information import InformationProbe
from flex_plant_sim.diagnosis.causes.sensitivity import SensitivityProbe
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.prediction import latent_view
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.free_run import horizon_errors, start_instants
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np
import pytest
from simulated_records import (
    effects,
    free_run_errors,
    predictor,
    REFERENCE,
    simulated,
    SLOWEST,
)

# Forward and backward level of two sizes, a contact.
UNEVEN = 'asymmetric_friction:joint_1'


def hypothesis(label: str) -> Hypothesis:
    """Return the first hypothesis of a label."""
    return next(h for h in all_hypotheses(REFERENCE) if h.label == label)


@pytest.fixture(scope='module')
def likelihood() -> Likelihood:
    """Return the likelihood of a short record without causes."""
    data = Data.of([simulated(duration=22.0)], SLOWEST, REFERENCE.sample_time)
    return Likelihood(BaseModel(REFERENCE), data.windows, data.noise)


@pytest.fixture
def passes(likelihood: Likelihood, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return the list that the number of arms of each pass is put on."""
    found: list[int] = []
    plain: Callable[..., Array] = likelihood.whitened_residual

    def counted(*args: Any) -> Array:
        residual = plain(*args)
        found.append(len(residual))
        return residual

    assert likelihood.part_jacobian.size
    monkeypatch.setattr(likelihood, 'whitened_residual', counted)
    return found


def test_starts_are_tried_in_one_pass(likelihood: Likelihood, passes: list[int]) -> None:
    spring = CauseSet([hypothesis('joint_spring:joint_1')], likelihood.duration)
    low, typical = spring.hypotheses[0].null, spring.hypotheses[0].typical_deviation
    starts = [low + share * typical for share in (0.5, 1.0, 2.0)]
    solver = GaussNewton(likelihood, spring, np.ones(6))
    best = min(solver.residual_and_cost(start)[1] for start in starts)
    passes.clear()
    assert solver.descend(starts).cost <= best * (1.0 + 1e-12)
    assert passes[0] == len(starts)


def test_information_takes_the_first_size_alone_and_null_once(likelihood: Likelihood,
                                                              passes: list[int]) -> None:
    uneven = hypothesis(UNEVEN)
    deviation = uneven.probe_deviations()[0]
    assert np.count_nonzero(uneven.is_size) > 1
    columns = likelihood.part_jacobian.reshape(len(likelihood.parts), -1)
    probe = InformationProbe(likelihood, columns, likelihood.tolerances, np.ones((6, 1)),
                             likelihood.duration)
    both, = SensitivityProbe(likelihood).sensitivities(uneven, deviation)
    null, = SensitivityProbe(likelihood).sensitivities(uneven, 0.0 * deviation)
    expected = both.changes[0] - null.changes[0]
    passes.clear()
    first = int(np.argmax(uneven.is_size))
    changes = [probe._changes(uneven, factor * deviation[first]) for factor in (1.0, 1.5, 2.0)]
    np.testing.assert_allclose(changes[0][0], expected, rtol=0.0, atol=1e-6)
    # Three sizes and null, an arm each.
    assert sum(passes) == 4


def test_only_the_ends_of_horizons_are_read(monkeypatch: pytest.MonkeyPatch) -> None:
    p, read = predictor(simulated(duration=24.0), locked=False), list[Array]()
    plain = ExtendedArm.output
    expected = free_run_errors(p, start_instants(int(p.windows.starts[0]), int(
        p.windows.starts[-1]) + p.windows.length), 100)

    def counted(arm: ExtendedArm, state: Array, time: Any) -> Array:
        read.append(state)
        return plain(arm, state, time)

    monkeypatch.setattr(ExtendedArm, 'output', counted)
    found = horizon_errors(p, (0.2, 1.0))
    assert len(read) == len(found) == 3
    for horizon, at_end in found.items():
        step = round(horizon / REFERENCE.sample_time)
        np.testing.assert_array_equal(at_end, expected[step - 1, :len(at_end)])


def test_laws_need_no_gauges_and_no_spectra(monkeypatch: pytest.MonkeyPatch) -> None:
    rubbing = predictor(simulated(effects('coulomb_friction:joint_2:level_n_m=0.6')))
    expected = latent_view.latent_view([rubbing]).laws
    for unread in ('gauge_series', 'line_of'):
        monkeypatch.setattr(latent_view, unread, None)
    found = latent_view.torque_laws([rubbing])
    assert [(law.site, law.variable) for law in found] == [('joint_2', 'speed')]
    for law, same in zip(found, expected, strict=True):
        np.testing.assert_array_equal(law.values, same.values)
