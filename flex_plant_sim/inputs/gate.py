"""One gate for what comes in: finite, in the arm's range, no faster than a drive can."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
import math
from operator import le

from flex_plant_sim.arm.drive import Drive
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from msg_config.input_mapping import JOINTS
import numpy as np

# Wires to the gauges and the second motor let a joint turn a few times and not more.
TURNS = 16
# No joint with a flexible link behind it turns faster, whatever its drive; used where the file
# limits no command.
FASTEST = 100.0
# Of a drive's steady speed: from one way to the other, without any loss, it would swing so far.
OVERSHOOT = 3.0
# Spring steel yields at 0.7 %, titanium at 0.9 %: more is no elastic strain of a metal.
METAL = 0.01
# Of the command limit: a current controller without any damping would overshoot so far.
COMMAND_MARGIN = 2.0
# Two neighbours' noise, so seldom passed that a night's samples hold none.
NOISE = 8.0
NOT_FINITE, RANGE, SPEED = 'not finite', 'out of range', 'too fast'


@dataclass(frozen=True)
class Limits:
    """
    What the arm's measurements cannot pass.

    Attributes
    ----------
    low, high : Array
        Of angles and strains, rad and m/m, (m,).
    speed : Array
        Of the joints, rad/s, (2,).
    command : Array
        Magnitude, in the drives' own unit, (2,).
    noise : float
        By how much noise alone can move an angle between two samples, rad.

    """

    low: Array
    high: Array
    speed: Array
    command: Array
    noise: float

    @classmethod
    def of(cls, robot: Robot) -> Limits:
        """
        Return what a robot's file allows.

        A strain may reach what turns the tip by a quarter under a tip force, which is
        pi b / (2 L) at the clamp (b: thickness), or where metals yield, whichever comes first;
        beyond, neither gauge nor beam theory holds.
        """
        ranges = np.clip(np.array(robot.angle_limits), -2.0 * np.pi * TURNS, 2.0 * np.pi * TURNS)
        strain = [min(METAL, np.pi * link.thickness / (2.0 * link.length))
                  for link in robot.links for _ in link.gauge_positions]
        drives = robot.drives
        speed = [min(FASTEST, OVERSHOOT * drive.torque_gain * drive.command_limit / drive.damping)
                 if drive.damping > 0.0 else FASTEST for drive in drives]
        return cls(np.array([*ranges[:, 0], *(-s for s in strain)]),
                   np.array([*ranges[:, 1], *strain]), np.array(speed),
                   COMMAND_MARGIN * np.array([_largest_command(drive) for drive in drives]),
                   NOISE * math.sqrt(2.0) * robot.angle_noise)


def _largest_command(drive: Drive) -> float:
    """Return what a drive takes; where its file does not say, what turns it at FASTEST."""
    if math.isfinite(drive.command_limit) or drive.damping == 0.0:
        return drive.command_limit
    return FASTEST * drive.damping / drive.torque_gain


@dataclass(frozen=True)
class Refusal:
    """Why a sample was refused: its kind (for counting) and one line."""

    kind: str
    text: str


class Gate:
    """
    Passes samples that the arm can have made, and counts the others by kind.

    A jump is judged from the last sample that passed; what was refused for CONVINCED samples in
    a row at steps that a drive can make is believed (the arm was moved by hand, or re-zeroed).

    Parameters
    ----------
    robot : Robot

    Attributes
    ----------
    refused : Counter
        Number of refusals by kind.

    """

    CONVINCED = 10

    def __init__(self, robot: Robot):
        self._names, self._interval = robot.output_names, robot.sample_time
        self.limits = Limits.of(robot)
        self.refused: Counter[str] = Counter()
        self.restart()

    def restart(self) -> None:
        """Judge the next sample's speed from nothing."""
        self._last: tuple[float, list[float]] | None = None
        self._doubted: tuple[float, list[float]] | None = None
        self._doubts = 0

    @property
    def limits(self) -> Limits:
        """Return what is in force."""
        return self._limits

    @limits.setter
    def limits(self, limits: Limits) -> None:
        # For a few numbers plain comparisons take a fifth of the time that arrays do.
        self._limits = limits
        self._low, self._high, self._fastest, self._command = (
            part.tolist() for part in (limits.low, limits.high, limits.speed, limits.command))

    def judge(self, time: float, output: Array, command: Array) -> Refusal | None:
        """
        Return why a sample cannot be, or None where it passes.

        Parameters
        ----------
        time : float
            s, later than the last.
        output : Array
            Angles and strains, rad and m/m, (m,).
        command : Array
            In the drives' own unit, (2,).

        """
        values = output.tolist()
        inside = all(map(le, self._low, values)) and all(map(le, values, self._high))
        refusal = (None if inside else self._measured(output)) \
            or (None if self.takes(command) else self._commanded(command)) \
            or self._speed(time, values[:2])
        if refusal is not None:
            self.refused[refusal.kind] += 1
        return refusal

    def takes(self, command: Array) -> bool:
        """Return whether a command is finite and inside the limits."""
        sizes = list(map(abs, command.tolist()))
        return all(map(le, sizes, self._command)) and all(map(math.isfinite, sizes))

    def _measured(self, output: Array) -> Refusal:
        if not math.isfinite(sum(output.tolist())):
            k = int(np.argmin(np.isfinite(output)))
            return Refusal(NOT_FINITE, f'{self._names[k]}: expected a finite number, '
                                       f'got {output[k]}')
        k = int(np.argmax((output < self.limits.low) | (output > self.limits.high)))
        unit = 'rad' if k < 2 else 'm/m'
        return Refusal(RANGE, f'{self._names[k]}: expected {self.limits.low[k]:.4g} to '
                              f'{self.limits.high[k]:.4g} {unit}, got {output[k]:.6g}')

    def _commanded(self, command: Array) -> Refusal:
        k = int(np.argmax(~(np.abs(command) <= self.limits.command) | ~np.isfinite(command)))
        if not math.isfinite(command[k]):
            return Refusal(NOT_FINITE, f'command of {JOINTS[k]}: expected a finite number, '
                                       f'got {command[k]}')
        return Refusal(RANGE, f'command of {JOINTS[k]}: expected at most '
                              f'{self.limits.command[k]:.4g}, got {command[k]:.6g}')

    def _speed(self, time: float, angle: list[float]) -> Refusal | None:
        k = self._too_fast(self._last, time, angle)
        if k is None or self._convinced(time, angle):
            self._last, self._doubts = (time, angle), 0
            return None
        assert self._last is not None
        step = angle[k] - self._last[1][k]
        return Refusal(SPEED, f'{JOINTS[k]}: expected at most {self.limits.speed[k]:.4g} rad/s, '
                              f'got a step of {step:+.4g} rad in {time - self._last[0]:.4g} s')

    def _too_fast(self, since: tuple[float, list[float]] | None, time: float,
                  angle: list[float]) -> int | None:
        """Return the first joint that no drive brings so far so soon."""
        if since is None:
            return None
        span = max(time - since[0], self._interval)
        for k, (now, before, speed) in enumerate(zip(angle, since[1], self._fastest)):
            if abs(now - before) > speed * span + self.limits.noise:
                return k
        return None

    def _convinced(self, time: float, angle: list[float]) -> bool:
        """Return whether the samples refused for their speed have long agreed among themselves."""
        agrees = self._doubts > 0 and self._too_fast(self._doubted, time, angle) is None
        self._doubts = self._doubts + 1 if agrees else 1
        self._doubted = (time, angle)
        return self._doubts > self.CONVINCED


def counted(refused: Counter[str] | dict[str, int]) -> str:
    """Return refusals by kind as text."""
    return ', '.join(f'{number} {kind}' for kind, number in sorted(refused.items()) if number)


def judge_all(gate: Gate, time: Array, output: Array, command: Array) -> Sequence[Refusal | None]:
    """Return the judgement of every row of a record, (N,), (N, m), (N, 2)."""
    if _all_pass(gate.limits, time, output, command):
        return [None] * len(time)
    return [gate.judge(float(t), y, u) for t, y, u in zip(time, output, command)]


def _all_pass(limits: Limits, time: Array, output: Array, command: Array) -> bool:
    """Return whether a fresh gate would refuse nothing: then each row is judged from the last."""
    if not bool(((output >= limits.low) & (output <= limits.high)).all()
                and (np.abs(command) <= limits.command).all() and np.isfinite(command).all()):
        return False
    reach = limits.speed * np.diff(time)[:, None] + limits.noise
    return bool((np.abs(np.diff(output[:, :2], axis=0)) <= reach).all())
