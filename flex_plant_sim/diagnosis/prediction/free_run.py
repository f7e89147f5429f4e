"""
Free runs: simulation by commands alone from filtered states, from many start instants at once.

They measure how well a model predicts over seconds, for the report and where sets with laws of
unknown torques are ranked.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from flex_plant_sim.arm.schedule import barycentric_weights
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.prediction.filter_run import drive_command, payload_schedule
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
import numpy as np
from numpy.typing import NDArray

# s: a quarter of the reference arm's slowest period (0.8 s), one period, and several.
HORIZONS = (0.2, 1.0, 2.0, 5.0)
# Start instants below which a horizon is left out: of fewer, none is beyond a 95 % interval.
FEWEST_STARTS = 20
# Runs at most; those from nearer instants overlap and add little information.
START_COUNT = 120


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
    found = _free_outputs(predictor, starts, range(steps), len(predictor.record.time))
    return np.array(list(found.values())).reshape(steps, len(starts), predictor.noise.size)


def _free_outputs(predictor: Predictor, starts: NDArray[np.int_], wanted: Collection[int],
                  stop: int) -> dict[int, Array]:
    """Return outputs of free runs at wanted steps, by step: (S, m); NaN from sample `stop` on."""
    record, base = predictor.record, predictor.base
    arm = base.arm(record.payload)
    payload, table = payload_schedule(arm, record.time, np.ones((len(record.time), 1)))
    command = drive_command(arm, record)[:, 0]
    n, order = arm.states, arm.form.order
    state, going = predictor.states[starts], np.arange(len(starts))
    found = {k: np.full((len(starts), predictor.noise.size), np.nan) for k in sorted(wanted)}
    with np.errstate(all='ignore'):
        for k in range(max(wanted, default=-1) + 1):
            left = starts[going] + k < stop
            if not left.all():
                state, going = state[left], going[left]
            if not going.size:
                break
            rows = starts[going] + k
            time = record.time[rows]
            if k in found:
                found[k][going] = arm.output(state, time)
            angle = barycentric_weights(np.cos(state[:, :order] @ arm.form.elbow_angle), arm.nodes)
            both = (payload[rows][:, :, None] * angle[:, None, :]).reshape(len(rows), -1)
            matrices = (both @ table).reshape(len(rows), n, -1)
            inputs = np.concatenate([state, command[rows]], axis=1)
            after = (matrices[..., :n + 2] @ inputs[..., None])[..., 0]
            state = arm.apply_effects(matrices[..., n + 2:], state, after, command[rows], time)
    return found


def end_errors(predictor: Predictor, starts: NDArray[np.int_], lengths: Collection[int],
               stop: int) -> dict[int, Array]:
    """
    Return measured minus simulated at the ends of free runs, by their length in samples: (S, m).

    Runs that would end after sample `stop`, exclusive, are left out.
    """
    simulated = _free_outputs(predictor, starts, [k - 1 for k in lengths], stop)
    return {k: predictor.record.output[starts[inside] + k - 1] - simulated[k - 1][inside]
            for k in lengths for inside in [starts + k <= stop]}


def horizon_samples(horizon: float, sample_time: float) -> int:
    """Return a horizon, s, in samples, at least one."""
    return max(1, round(horizon / sample_time))


def horizon_errors(predictor: Predictor, horizons: Sequence[float], count: int = START_COUNT
                   ) -> dict[float, Array]:
    """
    Return the errors at the end of free runs through a predictor's windows, by horizon: (S, m).

    Parameters
    ----------
    predictor : Predictor
        Of the model to judge.
    horizons : sequence of float
        s; one that leaves too few start instants is left out. One sample is always among them.
    count : int
        Start instants at most.

    """
    step = predictor.base.robot.sample_time
    first, stop = window_rows(predictor)
    starts = start_instants(first, stop, count)
    samples = {h: horizon_samples(h, step) for h in (step, *horizons)}
    kept = {h: k for h, k in samples.items()
            if np.count_nonzero(starts + k <= stop) >= min(FEWEST_STARTS, len(starts))}
    found = end_errors(predictor, starts, set(kept.values()), stop)
    return {h: found[k] for h, k in kept.items()}


def window_rows(predictor: Predictor) -> tuple[int, int]:
    """Return the first sample and the stop of a predictor's windows."""
    windows = predictor.windows
    return int(windows.starts[0]), int(windows.starts[-1]) + windows.length


def start_spacing(predictor: Predictor) -> int:
    """Return the samples between start instants."""
    starts = start_instants(*window_rows(predictor))
    return int(starts[1] - starts[0]) if len(starts) > 1 else 1
