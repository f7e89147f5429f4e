"""A measured or simulated record of the arm."""

from __future__ import annotations

from dataclasses import dataclass, replace

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.logs.origin import Origin
import numpy as np


@dataclass(frozen=True)
class Log:
    """
    What was sampled at `time` and the command applied from then on, N rows.

    Attributes
    ----------
    source : str
        File or bag, for messages.
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
    velocity : Array, optional
        Joint velocities, rad/s, (N, 2), where they were recorded.
    notes : tuple of str
        What a reader must know of how the record was made of what came, a line each.
    doubts : tuple of str
        Those of them for which the record is no evidence of the arm: it is not diagnosed.
    origin : Origin, optional
        The simulation that made it, where it says so.
    lost : Array, optional
        Which rows were lost and are interpolated, (N,), where any were.

    """

    source: str
    time: Array
    command: Array
    joint: Array
    strain: Array
    gauge_names: tuple[str, ...]
    velocity: Array | None = None
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
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
        """Return the output with NaN in the rows that were lost, (N, 2 + G)."""
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
        """Return T, s, the mean over the record, to a nanosecond."""
        return round(float(self.time[-1] - self.time[0]) / (len(self) - 1), 9)

    def part(self, start: int, stop: int) -> Log:
        """Return rows start to stop (exclusive)."""
        velocity = None if self.velocity is None else self.velocity[start:stop]
        lost = None if self.lost is None else self.lost[start:stop]
        return replace(self, time=self.time[start:stop], command=self.command[start:stop],
                       joint=self.joint[start:stop], strain=self.strain[start:stop],
                       velocity=velocity, lost=lost)
