"""The linear recursion of a scheduled predictor; compiled where Numba is installed."""

from __future__ import annotations

from flex_plant_sim.arm_model import Array
from flex_plant_sim.diagnosis.windows import Indices
import numpy as np

try:
    from numba import njit
except ImportError:
    njit = None  # type: ignore[assignment]


def scan(closed: Array, inputs: Array, start: Array, rows: Indices) -> Array:
    """
    Return the states x(k+1) = F_k x_k + d_k along every window, (S, W, B, n).

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

    """
    if _compiled is not None:
        return _compiled(closed, inputs, start, rows)
    states = np.empty(rows.shape + inputs.shape[1:])
    state = np.repeat(start[:, None], inputs.shape[1], axis=1)
    for k, row in enumerate(rows):
        states[k] = state
        state = np.matmul(state, np.swapaxes(closed[row], 1, 2)) + inputs[row]
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


_compiled = njit(cache=True, fastmath=True)(_loops) if njit is not None else None
