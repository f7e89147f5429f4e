"""Records cut into windows, with the noise of their sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.record.sensor_noise import measurement_noise
from flex_plant_sim.diagnosis.record.windows import Record, Windows
import numpy as np

# Samples in all windows at most; of longer records, evenly chosen windows are used. A budget.
SAMPLES = 12000
# Standard deviation of the strain and range of the angles, in standard deviations of their noise,
# below which a link or a joint counts as unmoved. Noise alone has 1 of the one and 7 to 10 of the
# other (4000 to 100 000 samples), the nine shared records 78 and 8800 at least.
MIN_STRAIN_SWING, MIN_ANGLE_SWING = 5.0, 30.0
# What helps where something is.
MOVE_MORE = ('Record 40 s or more with both joints following steps of at least 0.3 rad, '
             'with pauses of about a second')


@dataclass(frozen=True)
class Data:
    """Windows to work on, windows locked for the figures, sensor noise; one each per record."""

    windows: tuple[Windows, ...]
    locked: tuple[Windows, ...]
    noise: tuple[Array, ...]

    @classmethod
    def of(cls, records: Sequence[Record], slowest: float, sample_time: float,
           locks_first: bool = False) -> Data:
        """Cut the records by the slowest natural frequency, rad/s; see `Windows.cut`."""
        # All windows are equally long: as in the shortest record.
        shortest = min(Windows.cut(r, slowest, sample_time)[0].length for r in records)
        pairs = [Windows.cut(r, slowest, sample_time, locks_first, shortest) for r in records]
        noise = tuple(measurement_noise(r.measured) for r in records)
        scored = sum(work.starts.size * work.length for work, _ in pairs)
        every = -(-scored // SAMPLES)
        return cls(tuple(work.thinned(every) for work, _ in pairs),
                   tuple(locked for _, locked in pairs), noise)

    def with_commands_moved(self, rows: int) -> Data:
        """Return the same windows with commands that act rows earlier."""
        return replace(self, windows=tuple(w.with_commands_moved(rows) for w in self.windows))

    @property
    def duration(self) -> float:
        """Return the end of the longest record, s."""
        return max(float(w.record.time[-1]) for w in self.windows)


def unmoved(records: Sequence[Record], data: Data) -> tuple[str, ...]:
    """Return the joints and links that hardly moved in any record, of which `data` was made."""
    still = [f'joint_{j + 1}' for j in (0, 1) if MIN_ANGLE_SWING > max(
        np.ptp(r.output[:, j]) / n[j] for r, n in zip(records, data.noise))]
    swings = [np.std(r.output[:, 2:], axis=0) / n[2:] for r, n in zip(records, data.noise)]
    # An arm without gauges does not show whether its links bend.
    if np.size(swings) and np.max(swings) < MIN_STRAIN_SWING:
        still.append('the links')
    return tuple(still)
