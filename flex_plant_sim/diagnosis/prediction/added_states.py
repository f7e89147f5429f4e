"""First-order states that an effect adds to an arm whose trajectory was found without them."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.prediction.filter_run import drive_command
from flex_plant_sim.diagnosis.record.windows import Indices, Record
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

# How far an integral slips in a second, as a share of the angles' noise: without, no filter would
# ever correct what noise the first sample of a record has put into it.
SLIP = 1.0


def slip_variance(arm: ExtendedArm, noise: Array) -> Array:
    """Return the variance that a step adds to an arm's states because integrals slip, (n,)."""
    found = np.zeros(arm.states)
    found[integrators(arm, arm.own_states)] = arm.step_time * (SLIP * np.mean(noise[:2]))**2
    return found


def integrators(arm: ExtendedArm, known: int) -> Indices:
    """Return which states from `known` on only integrate: no added state depends on them."""
    return known + np.flatnonzero(~np.any(arm.plant.a[0, known:, known:], axis=0))


def matched_states(arm: ExtendedArm, other: ExtendedArm, known: Array) -> tuple[Array, int]:
    """Return an arm's states from those of another, (N, n), and how many the other knows."""
    n, own = arm.form.order, other.form.order
    states = np.zeros((len(known), arm.states))
    rest = min(known.shape[1] - 2 * own, arm.states - 2 * n)
    if arm.form.names == other.form.names:
        states[:, :2 * n + rest] = known[:, :2 * n + rest]
        return states, 2 * n + rest
    for place, name in enumerate(arm.form.names):
        if name in other.form.names:
            there = other.form.names.index(name)
            states[:, [place, n + place]] = known[:, [there, own + there]]
    states[:, 2 * n:2 * n + rest] = known[:, 2 * own:2 * own + rest]
    return states, 2 * n + rest


def states_at_rest(arm: ExtendedArm, known: Array, command: Array) -> Array:
    """Return added states, (N, n - k), at rest with the known ones, (N, k); integrals are zero."""
    first = known.shape[1]
    a, b = arm.plant.a[0], arm.plant.b[0]
    rest = np.setdiff1d(np.arange(first, arm.states), integrators(arm, first))
    driven = known @ a[rest, :first].T + command @ b[rest].T
    found = np.zeros((len(known), arm.states))
    found[:, rest] = -np.linalg.solve(a[np.ix_(rest, rest)], driven.T).T
    return found[:, first:]


def integrals(arm: ExtendedArm, rows: Indices, states: Array, record: Record) -> Array:
    """
    Return what states sum up from zero at a record's first sample on, (N, k).

    Parameters
    ----------
    arm : ExtendedArm
        The arm.
    rows : Indices
        Numbers of the states, (k,).
    states : Array
        All others at all samples, (N, n).
    record : Record
        The record.

    """
    n, a, b = arm.form.order, arm.plant.a[0, rows].copy(), arm.plant.b[0, rows]
    # The integral of a speed is the way, whatever is wrong with the speed that was filtered.
    found = (states[:, :n] - states[0, :n]) @ a[:, n:2 * n].T
    a[:, n:2 * n] = 0.0
    rates = states @ a.T + drive_command(arm, record)[:, 0] @ b.T
    found[1:] += np.cumsum(rates[:-1] * np.diff(record.time)[:, None], axis=0)
    return np.asarray(found)
