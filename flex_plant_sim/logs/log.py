"""
A log: the measured or simulated record of an arm on an even time grid, in SI units.

Every reader returns it; the replay, the estimators and the diagnosis take it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.logs.origin import Origin
import numpy as np


@dataclass(frozen=True)
class Log:
    """
    The samples taken at `time` and the command that acts from then on, N rows.

    Attributes
    ----------
    source : str
        File or bag, for error messages.
    time : Array
        s, (N,), evenly spaced.
    command : Array
        In the drives' own unit, (N, 2).
    joint : Array
        Joint angles, rad, (N, 2).
    strain : Array
        Surface strain, m/m, (N, G).
    gauge_names : tuple of str
        G names, in the robot's order.
    notes : tuple of str
        Notes for the user on how the log was made from the recording, one line each.
    doubts : tuple of str
        Those of the notes that make the log unfit as evidence of the arm: it is not diagnosed.
    misread : tuple of str
        Those of the notes by which an angle stepped as its joint cannot; and, once that is asked,
        see `log_input`, by which channels look exchanged, inverted, not logged, or in another
        unit.
    origin : Origin, optional
        The simulation that made the log, if known.
    lost : Array, optional
        1 in rows that were lost and are interpolated, else 0, (N,); None if none were.

    """

    source: str
    time: Array
    command: Array
    joint: Array
    strain: Array
    gauge_names: tuple[str, ...]
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    misread: tuple[str, ...] = ()
    origin: Origin | None = None
    lost: Array | None = None

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.time)

    @property
    def output(self) -> Array:
        """Return y = (theta_1, theta_2, strain…), (N, 2 + G)."""
        return np.hstack([self.joint, self.strain])

    @property
    def measured(self) -> Array:
        """Return the output with NaN in the lost rows, (N, 2 + G)."""
        output = self.output
        if self.lost is not None:
            output[self.lost.astype(bool)] = np.nan
        return output

    @property
    def output_names(self) -> tuple[str, ...]:
        """Return joint_1, joint_2 and the gauges."""
        return ('joint_1', 'joint_2', *self.gauge_names)

    @property
    def sample_time(self) -> float:
        """Return T, s: the mean interval of the record, rounded to a nanosecond."""
        return round(float(self.time[-1] - self.time[0]) / (len(self) - 1), 9)

    def part(self, start: int, stop: int) -> Log:
        """Return rows start to stop (exclusive)."""
        lost = None if self.lost is None else self.lost[start:stop]
        return replace(self, time=self.time[start:stop], command=self.command[start:stop],
                       joint=self.joint[start:stop], strain=self.strain[start:stop],
                       lost=lost)
