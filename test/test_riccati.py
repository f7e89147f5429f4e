"""One Riccati equation, many systems at once, against SciPy and its own residual."""

from __future__ import annotations

from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.diagnosis.record.sensor_noise import measurement_noise
from flex_plant_sim.diagnosis.record.windows import Windows
from flex_plant_sim.riccati import settled_cost
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from simulated_records import effects, REFERENCE, simulated, SLOWEST


def test_each_of_many_systems_has_scipy_s_solution() -> None:
    """Their states have units that differ by a million, and one of them settles slowly."""
    rng = np.random.default_rng(5)
    f = np.eye(4) + 0.1 * rng.standard_normal((3, 4, 4)) - 0.1 * np.eye(4)
    f[2] *= 0.9999 / np.abs(np.linalg.eigvals(f[2])).max()
    b, units = rng.standard_normal((3, 4, 2)), np.array([1.0, 1e3, 1e-3, 1.0])
    found = settled_cost((f - np.eye(4)) * units[:, None] / units,
                         (b @ np.swapaxes(b, 1, 2)) * units[:, None] * units,
                         np.broadcast_to(np.diag(units**-2), f.shape))
    for one, system, entry in zip(found, f, b):
        expected = solve_discrete_are(system, entry, np.eye(4), np.eye(2))
        np.testing.assert_allclose(units[:, None] * one * units, expected, rtol=0,
                                   atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize('growth', [0.0, 0.01])
def test_one_that_never_settles_is_said(growth: float) -> None:
    """A mode that does not decay, out of reach, beside a system that settles."""
    e = np.array([np.diag([-0.5, -0.5]), np.diag([-0.5, growth])])
    with pytest.raises(FloatingPointError, match='does not settle'):
        settled_cost(e, np.diag([1.0, 0.0]), np.eye(2))


def test_what_is_nothing_but_rounding_does_not_keep_a_system_from_settling() -> None:
    # With a lag of a sample, the variance of what the lag hides ends at -8e-57.
    record = simulated((), 22.0)
    windows, _ = Windows.cut(record, SLOWEST, REFERENCE.sample_time)
    predictor = Predictor(BaseModel(REFERENCE), windows, measurement_noise(record.output),
                          for_comparison=True)
    lagging = predictor.arm_with(effects('motor_lag:joint_1:time_constant_s=0.01'))
    assert np.isfinite(predictor.steady_filter_of(lagging).gain).all()
