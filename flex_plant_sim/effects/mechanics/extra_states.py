"""Room for first-order states behind those of the arm."""

from __future__ import annotations

from flex_plant_sim.arm.state_space import StateSpace
import numpy as np


def with_states(plant: StateSpace, count: int) -> StateSpace:
    """Return a fresh copy of the plant with `count` states at the end that stay at zero."""
    wide = [(0, 0)] * (plant.a.ndim - 2)
    below, right = (0, count), (0, count)
    return StateSpace(np.pad(plant.a, [*wide, below, right]),
                      np.pad(plant.b, [*wide, below, (0, 0)]),
                      np.pad(plant.e, [*wide, below, (0, 0)]),
                      np.pad(plant.c, [*wide, (0, 0), right]))
