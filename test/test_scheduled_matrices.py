"""The predictor's matrices at samples of a record, from close nodes that these lie between."""

from __future__ import annotations

from flex_plant_sim.arm.schedule import barycentric_weights, chebyshev_nodes
from flex_plant_sim.compiled import COMPILED
from flex_plant_sim.diagnosis.prediction.scheduled_matrices import (
    blend_into,
    NODE_SPACING,
    ScheduledMatrices,
)
import numpy as np
import pytest

NODES = chebyshev_nodes(7)
# Entries of all sizes, that change with the angle or do not; the last is nowhere.
SCALE = np.array([[1.0, 1e3, 1e-6], [5.0, 1e-3, 0.0]])
CHANGE = np.array([[0.0, 0.8, 1.0], [1e-4, -0.4, 1.0]])


def _table(payload: float = 1.0) -> np.ndarray:
    """Return entries that are a polynomial of degree 6 over cos(theta_2), (K, 2, 3)."""
    return np.asarray(payload * SCALE * np.exp(CHANGE * NODES[:, None, None]))


@pytest.mark.parametrize(('low', 'high', 'most'), [
    (0.977, 1.0, 5), (0.5, 1.0, 52), (-1.0, 1.0, 202), (0.3, 0.3, 2)])
def test_close_nodes_say_what_the_polynomial_does(low: float, high: float, most: int) -> None:
    cosine = np.linspace(low, high, 300)
    found = ScheduledMatrices.along(cosine, np.ones((300, 1)), NODES, _table()[None])
    assert len(found.table) <= most and found.weights.shape == (300, 2)
    exact = np.tensordot(barycentric_weights(cosine, NODES), _table(), 1)
    error = np.abs(found.interpolated(found.table) - exact) / np.maximum(SCALE, 1e-9)
    # The second derivative of e^c is e at most.
    assert error.max() < 1.01 * NODE_SPACING**2 / 8.0 * np.e
    assert found.interpolated(found.table)[:, 0, 0] == pytest.approx(1.0, abs=1e-14)
    some = np.array([5, 2])
    assert found.at(some).interpolated(3.0 * found.table) == pytest.approx(
        3.0 * found.interpolated(found.table)[some])


def test_between_two_payloads_it_is_a_line() -> None:
    cosine, share = np.array([0.31, -0.2]), np.array([[0.25, 0.75], [1.0, 0.0]])
    found = ScheduledMatrices.along(cosine, share, NODES, np.array([_table(1.0), _table(3.0)]))
    assert found.weights.sum(axis=1) == pytest.approx(1.0)
    alone = ScheduledMatrices.along(cosine, np.ones((2, 1)), NODES, _table()[None])
    assert found.interpolated(found.table) == pytest.approx(
        np.array([2.5, 1.0])[:, None, None] * alone.interpolated(alone.table))


def test_an_angle_that_diverged_is_no_row_of_a_table() -> None:
    with pytest.raises(np.linalg.LinAlgError, match='no finite prediction'):
        ScheduledMatrices.along(np.array([0.3, np.nan]), np.ones((2, 1)), NODES, _table()[None])


@pytest.mark.skipif(not COMPILED, reason='Numba is not installed')
def test_loops_blend_the_same() -> None:
    share = np.array([[0.25, 0.75]])
    one = ScheduledMatrices.along(np.array([0.31]), share, NODES,
                                  np.array([_table(1.0), _table(3.0)]))
    found = np.empty(SCALE.size)
    blend_into(one.nodes[0], one.weights[0], one.flat, found)
    assert found == pytest.approx(one.interpolated(one.table).ravel())
