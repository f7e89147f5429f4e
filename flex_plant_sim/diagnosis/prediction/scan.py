"""The recursion of a scheduled predictor; compiled where Numba is installed."""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED, compiled
from flex_plant_sim.diagnosis.record.windows import Indices
import numpy as np


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

    @classmethod
    def none(cls, n: int, velocity: int) -> Friction:
        """Return joints that turn freely."""
        return cls(np.zeros((0, n, 2)), np.zeros((0, 2)), np.zeros((0, 0, 2, 2)), velocity)


@dataclass(frozen=True)
class Gaps:
    """
    Backlashes along a record, G of them; see effects/backlash.py.

    Attributes
    ----------
    opened : Array
        What x adds to a step where rotor and link are apart, (G, N, n, n).
    pushed : Array
        What the commands add to it, (G, N, B, n).
    impulse : Array
        What a unit impulse on the joint does to the state, (G, N, n).
    motor : Array
        The rotor's torque, N m, (G, N, B).
    rotor : Array
        Inertia, damping, step, mean and end share of a decaying speed, half the gap, (G, 6).
    places : Array
        Joint, and place of the lead among the coordinates, (G, 2), int.
    velocity : int
        Place of the first joint velocity in the state.

    """

    opened: Array
    pushed: Array
    impulse: Array
    motor: Array
    rotor: Array
    places: Indices
    velocity: int

    @classmethod
    def none(cls, n: int) -> Gaps:
        """Return an arm without a gap."""
        return cls(np.zeros((0, 0, n, n)), np.zeros((0, 0, 0, n)), np.zeros((0, 0, n)),
                   np.zeros((0, 0, 0)), np.zeros((0, 6)), np.zeros((0, 2), dtype=np.int64), 0)


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
    if COMPILED:
        return scan_with_gaps(closed, inputs, start, rows, friction, Gaps.none(start.shape[1]))
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


def scan_with_gaps(closed: Array, inputs: Array, start: Array, rows: Indices,
                   friction: Friction | None, gaps: Gaps) -> Array:
    """Return the states as scan does, (S, W, B, n), backlashes opening and closing; in loops."""
    n = start.shape[1]
    f = friction or Friction.none(n, gaps.velocity)
    return _loops(closed, inputs, start, rows, f.columns, f.reach, f.limits, f.velocity,
                  gaps.opened, gaps.pushed, gaps.impulse, gaps.motor, gaps.rotor, gaps.places)


@compiled
def _loops(closed: Array, inputs: Array, start: Array, rows: Indices, columns: Array,
           reach: Array, limits: Array, velocity: int, opened: Array, pushed: Array,
           impulse: Array, motor: Array, rotor: Array, places: Indices) -> Array:
    steps, windows = rows.shape
    batch, n = inputs.shape[1:]
    states = np.empty((steps, windows, batch, n))
    for w in range(windows):
        for b in range(batch):
            states[0, w, b] = start[w]
            for k in range(steps - 1):
                row, state, after = rows[k, w], states[k, w, b], states[k + 1, w, b]
                for i in range(n):
                    total = inputs[row, b, i]
                    for j in range(n):
                        total += closed[row, i, j] * state[j]
                    after[i] = total
                for g in range(len(places)):
                    _gap(state, after, opened[g, row], pushed[g, row, b], impulse[g, row],
                         motor[g, row, b], rotor[g], places[g, 0], places[g, 1], velocity)
                if len(reach):
                    _stop(after, columns[row], reach[row], limits[row, b], velocity)
    return states


@compiled
def _stop(after: Array, columns: Array, reach: Array, limits: Array, velocity: int) -> None:
    first = max(-limits[1, 0], min(after[velocity] / reach[0], limits[0, 0]))
    second = max(-limits[1, 1], min(after[velocity + 1] / reach[1], limits[0, 1]))
    for i in range(len(after)):
        after[i] -= columns[i, 0] * first + columns[i, 1] * second


@compiled
def _gap(state: Array, after: Array, opened: Array, pushed: Array, impulse: Array, motor: float,
         rotor: Array, joint: int, lead: int, velocity: int) -> None:
    """Part rotor and link, or join them, as Backlash.on_step does."""
    inertia, damping, step, mean, end, half = rotor
    slip, old = state[velocity + lead], state[lead]
    speed, steady = state[velocity + joint] - slip, motor / damping
    turn = step * (steady + (speed - steady) * mean)
    parted = after[joint] + pushed[joint] + np.dot(opened[joint], state)
    apart = old + parted - state[joint] - turn
    after[lead] = max(-half, min(apart, half))
    if abs(apart) < half:
        for i in range(len(after)):
            if i != lead:
                after[i] += pushed[i] + np.dot(opened[i], state)
        after[velocity + lead] = after[velocity + joint] - steady - (speed - steady) * end
        return
    joining = damping * (after[lead] - old) - inertia * slip
    for i in range(len(after)):
        if i != lead:
            after[i] += impulse[i] * joining
    after[velocity + lead] = 0.0
