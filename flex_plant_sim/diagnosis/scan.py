"""The recursion of a scheduled predictor; compiled where Numba is installed."""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm_model import Array
from flex_plant_sim.diagnosis.windows import Indices
import numpy as np

try:
    from numba import njit
except ImportError:
    njit = None  # type: ignore[assignment]


@dataclass(frozen=True)
class Friction:
    """
    Dry friction of both joints along a record.

    Attributes
    ----------
    columns : Array
        What unit joint torques during a step do to the state, (N, n, 2).
    reach : Array
        What each does to its own joint's velocity, (N, 2).
    limits : Array
        Torques available against forward and backward motion, N m, (N, B, 2 ways, 2 joints).
    velocity : int
        Place of the first joint velocity in the state.

    """

    columns: Array
    reach: Array
    limits: Array
    velocity: int


def scan(closed: Array, inputs: Array, start: Array, rows: Indices,
         friction: Friction | None = None) -> Array:
    """
    Return the states x(k+1) = F_k x_k + d_k along every window, (S, W, B, n).

    With friction, each joint gets the torque that would stop it within the step, as far as its
    limits go (a time-stepping scheme; no chatter at any T).

    Parameters
    ----------
    closed : Array
        F, (N, n, n).
    inputs : Array
        d, (N, B, n).
    start : Array
        x_0, (W, n).
    rows : Indices
        Sample of each step, (S, W).
    friction : Friction, optional
        None where joints turn freely.

    """
    if _compiled is not None and friction is None:
        return _compiled(closed, inputs, start, rows)
    if _compiled_friction is not None and friction is not None:
        return _compiled_friction(closed, inputs, start, rows, friction.columns, friction.reach,
                                  friction.limits, friction.velocity)
    states = np.empty(rows.shape + inputs.shape[1:])
    state = np.repeat(start[:, None], inputs.shape[1], axis=1)
    for k, row in enumerate(rows):
        states[k] = state
        state = np.matmul(state, np.swapaxes(closed[row], 1, 2)) + inputs[row]
        if friction is not None:
            joints = state[..., friction.velocity:friction.velocity + 2]
            limits = friction.limits[row]
            torque = np.clip(joints / friction.reach[row][:, None], -limits[..., 1, :],
                             limits[..., 0, :])
            state = state - np.matmul(torque, np.swapaxes(friction.columns[row], 1, 2))
    return states


def _loops(closed: Array, inputs: Array, start: Array, rows: Indices) -> Array:
    steps, windows = rows.shape
    batch, n = inputs.shape[1:]
    states = np.empty((steps, windows, batch, n))
    for w in range(windows):
        for b in range(batch):
            states[0, w, b] = start[w]
            for k in range(steps - 1):
                row = rows[k, w]
                for i in range(n):
                    total = inputs[row, b, i]
                    for j in range(n):
                        total += closed[row, i, j] * states[k, w, b, j]
                    states[k + 1, w, b, i] = total
    return states


def _loops_friction(closed: Array, inputs: Array, start: Array, rows: Indices, columns: Array,
                    reach: Array, limits: Array, velocity: int) -> Array:
    steps, windows = rows.shape
    batch, n = inputs.shape[1:]
    states = np.empty((steps, windows, batch, n))
    torque = np.empty(2)
    for w in range(windows):
        for b in range(batch):
            states[0, w, b] = start[w]
            for k in range(steps - 1):
                row = rows[k, w]
                for i in range(n):
                    total = inputs[row, b, i]
                    for j in range(n):
                        total += closed[row, i, j] * states[k, w, b, j]
                    states[k + 1, w, b, i] = total
                for j in range(2):
                    stopping = states[k + 1, w, b, velocity + j] / reach[row, j]
                    torque[j] = max(-limits[row, b, 1, j],
                                    min(stopping, limits[row, b, 0, j]))
                for i in range(n):
                    states[k + 1, w, b, i] -= (columns[row, i, 0] * torque[0]
                                               + columns[row, i, 1] * torque[1])
    return states


def _compile(loops):  # type: ignore[no-untyped-def]
    return None if njit is None else njit(cache=True, fastmath=True)(loops)


_compiled, _compiled_friction = _compile(_loops), _compile(_loops_friction)
