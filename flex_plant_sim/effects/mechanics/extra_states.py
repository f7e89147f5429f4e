"""Adds first-order states of effects behind those of the arm."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.arm.state_space import StateSpace
import numpy as np


def with_states(plant: StateSpace, count: int) -> StateSpace:
    """Return a fresh copy of the plant with `count` states at the end that stay at zero."""
    return StateSpace(_wider(plant.a, count, count), _wider(plant.b, count, 0),
                      _wider(plant.e, count, 0), _wider(plant.c, 0, count))


def _wider(matrix: Array, rows: int, columns: int) -> Array:
    # Called for every hypothesis of a diagnosis; np.pad takes ten times as long.
    *points, height, width = matrix.shape
    found = np.zeros((*points, height + rows, width + columns))
    found[..., :height, :width] = matrix
    return found
