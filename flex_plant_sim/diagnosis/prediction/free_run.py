"""
Free runs: simulation by commands alone from filtered states, from many start instants at once.

The report measures with them how well a model predicts over seconds.
"""

from __future__ import annotations

from flex_plant_sim.arm.schedule import barycentric_weights
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.prediction.filter_run import drive_command, payload_schedule
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
import numpy as np
from numpy.typing import NDArray

# Runs at most; those from nearer instants overlap and add little information.
START_COUNT = 240


def start_instants(first: int, stop: int, count: int = START_COUNT) -> NDArray[np.int_]:
    """Return at most `count` evenly spaced sample numbers from first up to stop, exclusive."""
    return np.arange(first, stop, max(1, -(-(stop - first) // count)))


def free_run(predictor: Predictor, starts: NDArray[np.int_], steps: int) -> Array:
    """
    Simulate without corrections, with every effect of the predictor's base.

    A run starts at a predicted state, so its first output is the one-step prediction and output k
    is k + 1 samples after the last measurement used.

    Parameters
    ----------
    predictor : Predictor
        Its base is simulated, and runs start at its filtered states.
    starts : Array
        Sample numbers, (S,), int.
    steps : int
        Samples of each run.

    Returns
    -------
    Array
        Predicted outputs, (steps, S, m); NaN beyond the end of the record.

    """
    record, base = predictor.record, predictor.base
    arm = base.arm(record.payload)
    payload, table = payload_schedule(arm, record.time, np.ones((len(record.time), 1)))
    command = drive_command(arm, record)[:, 0]
    n, order = arm.states, arm.form.order
    state = predictor.states[starts]
    outputs = np.full((steps, len(starts), predictor.noise.size), np.nan)
    with np.errstate(all='ignore'):
        for k in range(steps):
            rows = np.minimum(starts + k, len(record.time) - 1)
            inside, time = starts + k < len(record.time), record.time[rows]
            outputs[k, inside] = arm.output(state, time)[inside]
            angle = barycentric_weights(np.cos(state[:, :order] @ arm.form.elbow_angle), arm.nodes)
            both = (payload[rows][:, :, None] * angle[:, None, :]).reshape(len(rows), -1)
            matrices = (both @ table).reshape(len(rows), n, -1)
            inputs = np.concatenate([state, command[rows]], axis=1)
            after = (matrices[..., :n + 2] @ inputs[..., None])[..., 0]
            state = arm.apply_effects(matrices[..., n + 2:], state, after, command[rows], time)
    return outputs


def errors(predictor: Predictor, starts: NDArray[np.int_], steps: int) -> Array:
    """Return measured minus simulated over free runs, (steps, S, m); NaN beyond the end."""
    simulated = free_run(predictor, starts, steps)
    rows = np.minimum(starts + np.arange(steps)[:, None], len(predictor.record.time) - 1)
    return predictor.record.output[rows] - simulated


def horizon_samples(horizon: float, sample_time: float) -> int:
    """Return a horizon, s, in samples, at least one."""
    return max(1, round(horizon / sample_time))
