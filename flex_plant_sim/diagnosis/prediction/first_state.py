"""The state at the first sample of a record: at rest, or in motion where the angles say so."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.prediction.filter_run import FilterRun
from flex_plant_sim.inputs.first_rates import first_rates, MOVES
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

# Standard deviation of each state around rest of an arm in motion, rad or m and their rates: wide.
START = 1.0


def first_state(arm: ExtendedArm, run: FilterRun, noise: Array, whitener: Array) -> Array:
    """
    Return the state at the first sample, (n,): at rest, or the likeliest of an arm in motion.

    Whether it moves is asked of the angles alone, because a wrong model, too, errs from the first
    sample on. The likeliest state is that of a linear regression of the first errors. Angles are
    those that the arm's sensors mean by their readings.

    Parameters
    ----------
    arm : ExtendedArm
        The arm that is filtered.
    run : FilterRun
        Its steady predictor through the record.
    noise : Array
        Standard deviations of the outputs, (m,).
    whitener : Array
        L^-1 of the innovations' covariance L L' at the first samples, (K, m, m).

    """
    count, rest = len(whitener), np.zeros(arm.states)
    angles = run.measured[:count, 0, :2]
    rest[:2] = angles[0]
    rates, deviations = first_rates(angles, 1.0, noise[:2])
    if not np.any(np.abs(rates) > MOVES * deviations):
        return rest
    states = np.vstack([rest, rest + START * np.eye(arm.states)])
    rows = np.repeat(np.arange(count)[:, None], len(states), axis=1)
    predicted = run.states(rows, states)[:, :, 0] @ arm.output_matrix.T
    errors = (whitener[:, None] @ (run.measured[:count] - predicted)[..., None])[..., 0]
    j = (errors[:, :1] - errors[:, 1:]).swapaxes(1, 2).reshape(-1, arm.states)
    change = np.linalg.solve(np.eye(arm.states) + j.T @ j, j.T @ errors[:, 0].ravel())
    return np.asarray(rest + START * change)
