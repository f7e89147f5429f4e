"""The predictor's matrices at samples of a record, from as few nodes as these need."""

from __future__ import annotations

from flex_plant_sim.arm.schedule import barycentric_weights, chebyshev_nodes
from flex_plant_sim.diagnosis.prediction.scheduled_matrices import (
    interpolated,
    ScheduledMatrices,
    TRUNCATION_TOLERANCE,
)
import numpy as np
import pytest

NODES = chebyshev_nodes(7)
# Entries of all sizes, that change with the angle or do not; the last is nowhere.
SCALE = np.array([[1.0, 1e3, 1e-6], [5.0, 1e-3, 0.0]])
CHANGE = np.array([[0.0, 0.8, 2.0], [1e-4, -0.4, 1.0]])


@pytest.mark.parametrize(('low', 'high', 'most'), [(0.97, 1.0, 3), (0.5, 1.0, 6), (-1.0, 1.0, 7)])
def test_few_nodes_say_what_all_do(low: float, high: float, most: int) -> None:
    table = SCALE * np.exp(CHANGE * NODES[:, None, None])
    weights = barycentric_weights(np.linspace(low, high, 300), NODES)
    fewer = ScheduledMatrices.reduced(weights, table)
    assert len(fewer.table) == fewer.weights.shape[1] <= most
    found = interpolated(fewer.weights, fewer.table)
    error = np.abs(found - interpolated(weights, table)) / np.maximum(SCALE, 1e-9)
    assert error.max() < TRUNCATION_TOLERANCE * np.exp(2.0)
    assert error[:, 0, 0].max() < 1e-14 and not found[:, 1, 2].any()
    assert interpolated(fewer.weights[:5], 3.0 * fewer.table) == pytest.approx(3.0 * found[:5])


def test_one_angle_needs_one_node() -> None:
    table = SCALE * np.exp(CHANGE * NODES[:, None, None])
    weights = np.repeat(barycentric_weights(np.array([0.3]), NODES), 20, axis=0)
    assert len(ScheduledMatrices.reduced(weights, table).table) == 1
