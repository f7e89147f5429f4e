"""
The sensors of an arm as a map: readings from outputs, outputs from readings.

The filter runs on outputs, so the effects at the sensors are taken off the measured readings, and
put on the errors that remain.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.record.windows import Indices, Record
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np


@dataclass(frozen=True, eq=False)
class SensorMap:
    """
    The sensors of an arm during a record.

    Attributes
    ----------
    arm : ExtendedArm
    record : Record

    """

    arm: ExtendedArm
    record: Record

    @cached_property
    def outputs(self) -> Array:
        """Return outputs without the affine sensor effects and delays, (N, 1 or B, m)."""
        return shifted(self._without_sensor_effects, self.arm.late)

    def reading_of_error(self, error: Array, time: Array) -> Array:
        """Return what the sensor effects make of errors (…, 1 or B, m) at times (…, 1)."""
        if not self.arm.acts_on_output:
            return error
        _, gains = self._constant
        if gains is None:
            return self.arm.sense(error, time) - self.arm.sense(np.zeros_like(error), time)
        return np.asarray(np.einsum('bij,...bj->...bi', gains, error), dtype=float)

    @property
    def _without_sensor_effects(self) -> Array:
        measured = self.record.output[:, None, :]
        if not self.arm.acts_on_output:
            return measured
        offsets, gains = self._constant
        if offsets is None or gains is None:
            offsets, gains = self._affine_at(self.record.time)
        apart, own = measured - offsets, np.diagonal(gains, axis1=-2, axis2=-1)
        if np.count_nonzero(gains) == np.count_nonzero(own):
            return np.asarray(apart / own, dtype=float)
        return np.asarray(np.linalg.solve(gains, apart[..., None])[..., 0], dtype=float)

    @cached_property
    def _constant(self) -> tuple[Array | None, Array | None]:
        """Return offsets (B, m) and gains (B, m, m); None for what changes during the record."""
        time = self.record.time
        offsets, gains = self._affine_at(time[[0, len(time) // 2, -1]])
        return (None if np.ptp(offsets, axis=0).any() else offsets[0],
                None if np.ptp(gains, axis=0).any() else gains[0])

    def _affine_at(self, time: Array) -> tuple[Array, Array]:
        """Return offsets (T, 1 or B, m) and gains (…, m, m) at times (T,)."""
        m = len(self.arm.late)
        units = np.concatenate([np.zeros((1, m)), np.eye(m)])[:, None, None]
        seen = self.arm.sense(np.repeat(units, len(time), 1), time[:, None])
        return seen[0], np.asarray(np.moveaxis(seen[1:] - seen[0], 0, -1), dtype=float)


def shifted(outputs: Array, ahead: Indices) -> Array:
    """Return outputs (N, …, m), each from (m,) samples ahead; the first or last value is held."""
    if not ahead.any():
        return outputs
    found = outputs.copy()
    for k in np.flatnonzero(ahead):
        rows = np.clip(np.arange(len(outputs)) + ahead[k], 0, len(outputs) - 1)
        found[..., k] = outputs[rows, ..., k]
    return found
