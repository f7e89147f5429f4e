"""The move that tells what a log of an arm could tell: both joints to and fro, smoothly."""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.assumed_modes import assumed_modes
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
import numpy as np

AMPLITUDE = 0.25
STROKE = 1.0
STROKES = 10
SLOWER = 1.25
SLOWEST = 50.0


@dataclass(frozen=True)
class Move:
    """
    Commands of a move.

    Attributes
    ----------
    stroke : float
        Duration of one stroke, s.
    commands : Array
        In the drives' own units, (N, 2).

    """

    stroke: float
    commands: Array

    @property
    def strokes(self) -> int:
        """Return how many strokes the move has."""
        return STROKES


def standard_move(robot: Robot) -> Move:
    """
    Return ten minimum-jerk strokes of 0.5 rad, of 1 s or as much slower as the drives need.

    The commands are those of a rigid arm, so that any kind of drive makes about the same move.
    """
    stroke = STROKE
    while True:
        commands = _commands(robot, stroke)
        limits = [drive.command_limit for drive in robot.drives]
        if np.all(np.abs(commands) <= limits) or stroke > SLOWEST:
            return Move(stroke, np.clip(commands, np.negative(limits), limits))
        stroke *= SLOWER


def _commands(robot: Robot, stroke: float) -> Array:
    speed, acceleration = _profile(robot.sample_time, stroke)
    inertia = assumed_modes(robot, 1).mass_at(1.0, robot.payload_mass)[:2, :2].sum(axis=1)
    damping = np.array([drive.damping for drive in robot.drives])
    gain = np.array([drive.torque_gain for drive in robot.drives])
    return (speed[:, None] * damping + acceleration[:, None] * inertia) / gain


def _profile(step: float, stroke: float) -> tuple[Array, Array]:
    """Return speed and acceleration of the strokes (N,): 10 s^3 - 15 s^4 + 6 s^5, to and fro."""
    time = step * (np.arange(round(STROKES * stroke / step)) + 0.5)
    s = time / stroke % 1.0
    # The first stroke goes from the middle to one side, so it is half as long.
    sign = np.where((time // stroke).astype(int) % 2 == 0, 1.0, -1.0)
    sign[time < stroke] = 0.5
    size = 2.0 * AMPLITUDE * sign
    speed = size * 30.0 * s**2 * (1.0 - s)**2 / stroke
    acceleration = size * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / stroke**2
    return speed, acceleration
