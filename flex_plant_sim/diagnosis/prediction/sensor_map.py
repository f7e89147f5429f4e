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

    def reading_of_error(self, error: Array, rows: Indices) -> Array:
        """Return what the sensor effects make of errors (…, 1 or B, m) at samples (…,)."""
        if not self.arm.acts_on_output:
            return error
        _, gains, own = self._affine
        if own is not None:
            return np.asarray((own[0] if len(own) == 1 else own[rows]) * error, dtype=float)
        if len(gains) == 1:
            return np.asarray(np.einsum('bij,...bj->...bi', gains[0], error), dtype=float)
        return np.asarray((gains[rows] @ error[..., None])[..., 0], dtype=float)

    @property
    def _without_sensor_effects(self) -> Array:
        measured = self.record.output[:, None, :]
        if not self.arm.acts_on_output:
            return measured
        offsets, gains, own = self._affine
        apart = measured - offsets
        if own is not None:
            return np.asarray(apart / own, dtype=float)
        return np.asarray(np.linalg.solve(gains, apart[..., None])[..., 0], dtype=float)

    @cached_property
    def _affine(self) -> tuple[Array, Array, Array | None]:
        """
        Return offsets (1 or N, 1 or B, m) and gains (…, m, m), one for all samples if constant.

        And the gains' diagonals, (…, m), if they have nothing beside; else None.
        """
        time = self.record.time
        offsets, gains = self._affine_at(time[[0, len(time) // 2, -1]])
        if np.ptp(offsets, axis=0).any() or np.ptp(gains, axis=0).any():
            offsets, gains = self._affine_at(time)
        else:
            offsets, gains = offsets[:1], gains[:1]
        own = np.diagonal(gains, axis1=-2, axis2=-1)
        crossing = np.count_nonzero(gains) > np.count_nonzero(own)
        return offsets, gains, None if crossing else own

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
