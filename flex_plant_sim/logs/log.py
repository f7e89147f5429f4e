"""A measured or simulated record of the arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from flex_plant_sim.arm.second_order import Array
from msg_config.errors import InputError
import numpy as np

# A recorder's clock may jitter this much of a sample; a lost sample is a whole one.
SAMPLING_JITTER = 0.1


@dataclass(frozen=True)
class Log:
    """
    What was sampled at `time` and the command applied from then on, N rows.

    Attributes
    ----------
    source : str
        File or bag, for messages.
    time : Array
        s, (N,).
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

    """

    source: str
    time: Array
    command: Array
    joint: Array
    strain: Array
    gauge_names: tuple[str, ...]
    velocity: Array | None = None

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.time)

    @property
    def output(self) -> Array:
        """Return y = (theta_1, theta_2, strain…), (N, 2 + G)."""
        return np.hstack([self.joint, self.strain])

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
        return replace(self, time=self.time[start:stop], command=self.command[start:stop],
                       joint=self.joint[start:stop], strain=self.strain[start:stop],
                       velocity=velocity)


def checked(log: Log, row: Callable[[int], str]) -> Log:
    """
    Return the log if its numbers are finite and its time runs evenly.

    Parameters
    ----------
    log : Log
        As read.
    row : callable
        Names row k (from 0) as the reader's user finds it.

    Raises
    ------
    InputError

    """
    if len(log) < 2:
        raise InputError(f'{log.source}: expected at least 2 samples, got {len(log)}')
    _check_finite(log, row)
    interval = np.diff(log.time)
    if np.any(interval <= 0.0):
        k = int(np.argmax(interval <= 0.0)) + 1
        raise InputError(f'{log.source}: {row(k)}: time: expected more than '
                         f'{log.time[k - 1]:.9g} s, got {log.time[k]:.9g} s')
    usual = float(np.median(interval))
    uneven = np.abs(interval - usual) > SAMPLING_JITTER * usual
    if np.any(uneven):
        k = int(np.argmax(uneven)) + 1
        raise InputError(f'{log.source}: {row(k)}: time: expected {usual:.6g} s after the row '
                         f'before, got {interval[k - 1]:.6g} s')
    return log


def _check_finite(log: Log, row: Callable[[int], str]) -> None:
    names = ['time', 'command_1', 'command_2', *log.output_names]
    columns = [log.time[:, None], log.command, log.output]
    if log.velocity is not None:
        names += ['velocity_1', 'velocity_2']
        columns.append(log.velocity)
    values = np.hstack(columns)
    bad = np.argwhere(~np.isfinite(values))
    if bad.size:
        k, column = bad[0]
        raise InputError(f'{log.source}: {row(int(k))}: {names[column]}: expected a finite '
                         f'number, got {values[k, column]}')
