"""Set-points of the joints: random moves from a seed, each of minimum jerk."""

from __future__ import annotations

import numpy as np

from truth.beam_elements import Array
from truth.configuration import Excitation


def minimum_jerk(share: Array) -> Array:
    """Return the minimum-jerk rise from 0 to 1 over `share` in [0, 1] (Flash and Hogan 1985)."""
    s = np.clip(share, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


def joint_set_points(rng: np.random.Generator, time: Array, plan: Excitation,
                     joint: int) -> Array:
    """Return set-points (N,) rad of one joint at `time` (N,) s, starting at zero."""
    reference = np.zeros(time.size)
    start, level = 0.0, 0.0
    while start < time[-1]:
        stride = rng.uniform(-1.0, 1.0) * plan.stride[joint]
        target = float(np.clip(level + stride, -plan.reach[joint], plan.reach[joint]))
        rise = rng.uniform(*plan.rise)
        reference += (target - level) * minimum_jerk((time - start) / rise)
        level = target
        start += rng.uniform(*plan.hold)
    return reference


def set_points(rng: np.random.Generator, time: Array, plan: Excitation) -> Array:
    """Return set-points (N, 2) rad of both joints."""
    return np.column_stack([joint_set_points(rng, time, plan, j) for j in range(2)])
