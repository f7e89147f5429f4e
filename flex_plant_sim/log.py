"""A measured or simulated record of the arm, and the readers that give one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from flex_plant_sim.arm_model import Array
from flex_plant_sim.errors import InputError
from flex_plant_sim.robot import Robot
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


class LogReader(Protocol):
    """A storage format of logs."""

    def __call__(self, path: Path, robot: Robot) -> Log:
        """
        Return the record in a file or folder, checked.

        Raises
        ------
        InputError
            Naming file and row, column or topic, what was expected and what came.

        """


def read_log(path: str | Path, robot: Robot) -> Log:
    """
    Return the record in a CSV file or in a rosbag2 (sqlite3, MCAP; folder or single file).

    Raises
    ------
    InputError
        Naming file and row, column or topic, what was expected and what came.

    """
    path = Path(path)
    if not path.exists():
        raise InputError(f'{path}: expected a log, the file does not exist')
    return _reader(path)(path, robot)


def _reader(path: Path) -> LogReader:
    # The formats build Logs, so they import this file and not it them.
    if path.is_dir() or path.suffix in ('.mcap', '.db3'):
        from flex_plant_sim.log_bag import read_bag
        return read_bag
    if path.suffix == '.csv':
        from flex_plant_sim.log_csv import read_csv
        return read_csv
    raise InputError(f'{path}: expected .csv, .mcap, .db3 or a bag folder, got {path.suffix!r}')


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
