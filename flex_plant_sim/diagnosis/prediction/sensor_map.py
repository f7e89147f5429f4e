"""
The sensors of an arm as a map: readings from outputs, outputs from readings.

The filter runs on outputs, so the effects at the sensors are taken off the measured readings, and
put on the errors that remain.
"""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.record.windows import Indices, Record
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np


def invert_sensors(arm: ExtendedArm, record: Record) -> Array:
    """Return outputs without the affine sensor effects and delays, (N, 1 or B, m)."""
    return shifted(_without_sensor_effects(arm, record), arm.late)


def shifted(outputs: Array, ahead: Indices) -> Array:
    """Return outputs (N, …, m), each from (m,) samples ahead; the first or last value is held."""
    if not ahead.any():
        return outputs
    found = outputs.copy()
    for k in np.flatnonzero(ahead):
        rows = np.clip(np.arange(len(outputs)) + ahead[k], 0, len(outputs) - 1)
        found[..., k] = outputs[rows, ..., k]
    return found


def sensor_reading_of_error(arm: ExtendedArm, error: Array, time: Array) -> Array:
    """Return what the sensor effects make of errors (…, 1 or B, m) at times (…, 1)."""
    if not arm.acts_on_output:
        return error
    _, gains = _constant_map(arm, time.reshape(-1, 1))
    if gains is None:
        return arm.sense(error, time) - arm.sense(np.zeros_like(error), time)
    return np.asarray(np.einsum('bij,...bj->...bi', gains, error), dtype=float)


def _without_sensor_effects(arm: ExtendedArm, record: Record) -> Array:
    measured = record.output[:, None, :]
    if not arm.acts_on_output:
        return measured
    time = record.time[:, None]
    offsets, gains = _constant_map(arm, time)
    if offsets is None or gains is None:
        offsets, gains = _affine_map(arm, time)
    apart, own = measured - offsets, np.diagonal(gains, axis1=-2, axis2=-1)
    if np.count_nonzero(gains) == np.count_nonzero(own):
        return np.asarray(apart / own, dtype=float)
    return np.asarray(np.linalg.solve(gains, apart[..., None])[..., 0], dtype=float)


def _constant_map(arm: ExtendedArm, time: Array) -> tuple[Array | None, Array | None]:
    """Return offsets (B, m) and gains (B, m, m); None for what changes over times (T, 1)."""
    offsets, gains = _affine_map(arm, time[[0, len(time) // 2, -1]])
    return (None if np.ptp(offsets, axis=0).any() else offsets[0],
            None if np.ptp(gains, axis=0).any() else gains[0])


def _affine_map(arm: ExtendedArm, time: Array) -> tuple[Array, Array]:
    """Return offsets (T, 1 or B, m) and gains (…, m, m) of the sensor effects at times (T, 1)."""
    m = len(arm.late)
    units = np.concatenate([np.zeros((1, m)), np.eye(m)])[:, None, None]
    seen = arm.sense(np.repeat(units, len(time), 1), time)
    return seen[0], np.asarray(np.moveaxis(seen[1:] - seen[0], 0, -1), dtype=float)
