"""
Refuses samples that the arm cannot have produced: not finite, out of range, or too fast.

Live measurements and rows of logs pass this gate before anything is computed from them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Sequence
from dataclasses import dataclass
import math
from operator import le

from flex_plant_sim.arm.drive import Drive
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from msg_config.input_mapping import JOINTS
import numpy as np

# Turns of a joint whose limits are not told: the wires to the gauges and to the second motor allow
# only a few.
MAX_TURNS = 16
# Joint speed, rad/s, that no joint with a flexible link exceeds, whatever its drive; it replaces
# the drive's limit if the robot file limits no command.
MAX_SPEED = 100.0
# Largest joint speed over the steady speed of a velocity loop: what a reversal without any loss
# would reach.
OVERSHOOT = 3.0
# Turn, rad, over which a drive without such a loop may gain speed: moves from stop to stop are no
# longer. Its damping is friction, which a robot file often has far too large.
RUN_UP = math.pi
# Largest elastic strain of a metal, m/m: spring steel yields at 0.7 %, titanium at 0.9 %.
YIELD_STRAIN = 0.01
# Largest command over the command limit: the overshoot of a current controller without damping.
COMMAND_MARGIN = 2.0
# Standard deviations of its noise by which a sample may be off: exceeded so rarely that a night's
# samples contain no case. It holds rounding, too: an encoder's step is 3.5 deviations.
NOISE_MARGIN = 8.0
# One turn, and what a joint may move beside it in a sample, rad: by more, the step is no turn.
TURN, LIKE_A_TURN = 2.0 * math.pi, 0.2
# Kinds of refusal.
NOT_FINITE, RANGE, SPEED = 'not finite', 'out of range', 'too fast'


@dataclass(frozen=True)
class Limits:
    """
    Bounds of the measurements and commands of an arm.

    Attributes
    ----------
    low, high : Array
        Least and largest angles and strains, rad and m/m, (m,).
    speed : Array
        Largest joint speeds, rad/s, (2,).
    command : Array
        Largest magnitude of the commands, in the drives' own unit, (2,).
    noise : float
        Largest change of an angle between two samples by noise alone, rad.

    """

    low: Array
    high: Array
    speed: Array
    command: Array
    noise: float

    @classmethod
    def of(cls, robot: Robot) -> Limits:
        """
        Return the bounds that follow from a robot file.

        The bound of a strain is the lesser of two: the strain at the clamp when a tip force turns
        the tip by a quarter turn, pi b / (2 L) (b: thickness), and the strain at which metals
        yield. Beyond, neither the gauge nor beam theory holds.
        """
        # A joint that rests on its stop reads beyond it in every second sample.
        margin = NOISE_MARGIN * robot.angle_noise
        ranges = angle_ranges(robot) + np.array([-margin, margin])
        strain = [min(YIELD_STRAIN, np.pi * link.thickness / (2.0 * link.length))
                  for link in robot.links for _ in link.gauge_positions]
        drives = robot.drives
        speed = [min(MAX_SPEED, _largest_speed(robot, joint)) for joint in (0, 1)]
        return cls(np.array([*ranges[:, 0], *(-s for s in strain)]),
                   np.array([*ranges[:, 1], *strain]), np.array(speed),
                   COMMAND_MARGIN * np.array([_largest_command(drive) for drive in drives]),
                   math.sqrt(2.0) * margin)


def angle_ranges(robot: Robot) -> Array:
    """Return the least and largest angles of the joints, rad, (2, 2)."""
    told, most = np.array(robot.angle_limits), MAX_TURNS * TURN
    return np.where(np.isfinite(told), told, [-most, most])


def _largest_speed(robot: Robot, joint: int) -> float:
    """
    Return the speed, rad/s, beyond which a joint is not believed.

    Of a drive without a velocity loop, what its torque gives to the least that it can carry, rotor
    and own link, over RUN_UP without any loss.
    """
    drive, link = robot.drives[joint], robot.links[joint]
    torque = drive.torque_gain * drive.command_limit
    if drive.closed_loop and drive.damping > 0.0:
        return OVERSHOOT * torque / drive.damping
    least = drive.inertia + link.mass * link.length**2 / 3.0
    return math.sqrt(2.0 * torque * RUN_UP / least)


def _largest_command(drive: Drive) -> float:
    """Return a drive's command limit; if the file has none, the command for MAX_SPEED."""
    if math.isfinite(drive.command_limit) or drive.damping == 0.0:
        return drive.command_limit
    return MAX_SPEED * drive.damping / drive.torque_gain


@dataclass(frozen=True)
class Refusal:
    """
    Why a sample was refused.

    Attributes
    ----------
    kind : str
        By which refusals are counted.
    channel, words : str
        What was refused; what was expected of it and found.
    unit : str
        rad, rad/s, turns or m/m; empty for a command, whose unit is the drive's own.
    value, low, high : float
        The number that was refused and its bounds, in that unit.

    """

    kind: str
    channel: str
    words: str
    unit: str
    value: float
    low: float
    high: float

    @property
    def text(self) -> str:
        """Return the refusal in one line."""
        return f'{self.channel}: {self.words}'

    @property
    def excess(self) -> float:
        """Return how far the value is beyond its bounds, over their distance; 0 if not finite."""
        beyond = max(self.low - self.value, self.value - self.high)
        return beyond / (self.high - self.low) if math.isfinite(self.value) else 0.0


def refuse_command(command: Array, largest: Array) -> Refusal:
    """Return why a command (2,) that is not finite, or larger than (2,), is refused."""
    k = int(np.argmax(~(np.abs(command) <= largest) | ~np.isfinite(command)))
    value, most = float(command[k]), float(largest[k])
    finite = math.isfinite(value)
    words = f'expected at most {most:.4g}, got {value:.6g}' if finite else _not_finite(value)
    return Refusal(RANGE if finite else NOT_FINITE, f'command of {JOINTS[k]}', words, '', value,
                   -most, most)


def _not_finite(value: float) -> str:
    return f'expected a finite number, got {value}'


class Gate:
    """
    Passes samples that the arm can have produced, and counts the others by kind.

    The speed of a sample is taken from the last one that passed. After CONVINCED samples in a row
    that were refused for their speed but are consistent with one another, the new position is
    believed: the arm was moved by hand, or an encoder was zeroed again. A step of whole turns is
    never believed: an angle that is wrapped makes it, and the joint did not. Of logs, whose later
    rows are known, `angle_steps` undoes such turns, and tells which steps are believed.

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
        """Forget the last sample, so that the next one passes whatever its speed."""
        self._last: tuple[float, list[float]] | None = None
        self._doubted: tuple[float, list[float]] | None = None
        self._wrapped: int | None
        self._doubts, self._wrapped = 0, None

    @property
    def limits(self) -> Limits:
        """Return the bounds in force."""
        return self._limits

    @limits.setter
    def limits(self, limits: Limits) -> None:
        # Comparing a few numbers as lists takes a fifth of the time that arrays take.
        self._limits = limits
        self._low, self._high, self._fastest, self._command = (
            part.tolist() for part in (limits.low, limits.high, limits.speed, limits.command))

    def judge(self, time: float, output: Array, command: Array) -> Refusal | None:
        """
        Return why a sample is refused, or None if it passes.

        Parameters
        ----------
        time : float
            s, later than that of the sample before.
        output : Array
            Angles and strains, rad and m/m, (m,).
        command : Array
            Command in the drives' own unit, (2,).

        """
        values = output.tolist()
        inside = all(map(le, self._low, values)) and all(map(le, values, self._high))
        refusal = (None if inside else self._refuse_output(output)) \
            or (None if self.takes(command) else refuse_command(command, self.limits.command)) \
            or self._judge_speed(time, values[:2])
        if refusal is not None:
            self.refused[refusal.kind] += 1
        return refusal

    def takes(self, command: Array) -> bool:
        """Return whether a command is finite and inside the limits."""
        sizes = list(map(abs, command.tolist()))
        return all(map(le, sizes, self._command)) and all(map(math.isfinite, sizes))

    def _refuse_output(self, output: Array) -> Refusal:
        finite = np.isfinite(output)
        wrong = ~finite if not finite.all() else (
            (output < self.limits.low) | (output > self.limits.high))
        k = int(np.argmax(wrong))
        value, low, high = float(output[k]), self._low[k], self._high[k]
        unit = 'rad' if k < 2 else 'm/m'
        words = f'expected {low:.4g} to {high:.4g} {unit}, got {value:.6g}' \
            if finite[k] else _not_finite(value)
        return Refusal(RANGE if finite[k] else NOT_FINITE, self._names[k], words, unit, value,
                       low, high)

    def _judge_speed(self, time: float, angle: list[float]) -> Refusal | None:
        # After a turn, time alone must not make the same angle slow enough.
        lasts = self._wrapped is not None and self._too_fast(self._doubted, time, angle) is None
        k = self._wrapped if lasts else self._too_fast(self._last, time, angle)
        if k is None:
            self._pass(time, angle)
            return None
        assert self._last is not None
        step, span = angle[k] - self._last[1][k], time - self._last[0]
        wrapped = lasts or self._is_turn(step, self._fastest[k] * span + self.limits.noise)
        self._wrapped = k if wrapped else None
        if self._convinced(time, angle) and not wrapped:
            self._pass(time, angle)
            return None
        unit, one = ('turns', TURN) if wrapped else ('rad/s', span)
        return Refusal(SPEED, JOINTS[k], f'expected at most {self._fastest[k]:.4g} rad/s, '
                       f'got a step of {step:+.4g} rad in {span:.4g} s'
                       + (' (a turn: is the angle wrapped?)' if wrapped else ''),
                       unit, abs(step) / one, 0.0, self._fastest[k] * span / one)

    def _is_turn(self, step: float, most: float) -> bool:
        """Return whether a step is whole turns but for what the joint moves, `most`, rad."""
        # A turn is made from one sample to the next: later, any step is near one.
        begins = not self._doubts or self._wrapped is not None
        return begins and abs(step) > 0.5 * TURN and abs(
            math.remainder(step, TURN)) <= min(most, LIKE_A_TURN)

    def _pass(self, time: float, angle: list[float]) -> None:
        self._last, self._doubts, self._wrapped = (time, angle), 0, None

    def _too_fast(self, since: tuple[float, list[float]] | None, time: float,
                  angle: list[float]) -> int | None:
        """Return the first joint that would have moved faster than allowed; None if none did."""
        if since is None:
            return None
        span = max(time - since[0], self._interval)
        for k, (now, before, speed) in enumerate(zip(angle, since[1], self._fastest)):
            if abs(now - before) > speed * span + self.limits.noise:
                return k
        return None

    def _convinced(self, time: float, angle: list[float]) -> bool:
        """Return whether more than CONVINCED refused samples in a row are consistent."""
        agrees = self._doubts > 0 and self._too_fast(self._doubted, time, angle) is None
        self._doubts = self._doubts + 1 if agrees else 1
        self._doubted = (time, angle)
        return self._doubts > self.CONVINCED


def counted(refused: Counter[str] | dict[str, int]) -> str:
    """Return the numbers of refusals by kind as text."""
    return ', '.join(f'{number} {kind}' for kind, number in sorted(refused.items()) if number)


def judge_record(gate: Gate, time: Array, output: Array, command: Array,
                 believed: Container[int] = ()) -> Sequence[Refusal | None]:
    """
    Return why each row is refused, or None, for times (N,), outputs (N, m), commands (N, 2).

    Steps to the rows that are `believed` are not judged.
    """
    if _all_pass(gate.limits, time, output, command):
        return [None] * len(time)
    refusals = []
    for k, (t, y, u) in enumerate(zip(time, output, command)):
        if k in believed:
            gate.restart()
        refusals.append(gate.judge(float(t), y, u))
    return refusals


def _all_pass(limits: Limits, time: Array, output: Array, command: Array) -> bool:
    """Return whether a fresh gate would pass every row, checked for all rows at once."""
    if not bool(((output >= limits.low) & (output <= limits.high)).all()
                and (np.abs(command) <= limits.command).all() and np.isfinite(command).all()):
        return False
    reach = limits.speed * np.diff(time)[:, None] + limits.noise
    return bool((np.abs(np.diff(output[:, :2], axis=0)) <= reach).all())
