"""
The standard move, in which both joints swing smoothly to and fro.

The observability bound and simulated logs use it; `flex_robot move` writes it for the real arm.
"""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.assumed_modes import assumed_modes
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.logs.csv_table import MAX_BYTES
from flex_plant_sim.logs.log import Log
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.nominal import nominal_effects
from flex_plant_sim.simulation.simulator import Noise, simulate, Simulator
from msg_config.errors import InputError
import numpy as np

# Amplitude, rad, and duration, s, of a stroke: 0.5 rad from side to side, during which the links
# of a bench arm swing about twice.
AMPLITUDE, STROKE = 0.25, 1.0
# Duration of the elbow's strokes over the shoulder's: with different durations, every combination
# of the two occurs.
ELBOW_SHARE = 0.8
# Number of strokes: ten seconds, as in the run of the demo.
STROKES = 10
# Factor by which a stroke is made longer if the drives cannot follow it, and its longest
# duration, s.
SLOWER, SLOWEST = 1.25, 50.0
# Largest number of samples, so that the log as CSV, some 140 bytes each, can be read again.
MAX_SAMPLES = MAX_BYTES // 160


@dataclass(frozen=True)
class Move:
    """
    The commands of a move.

    Attributes
    ----------
    stroke : float
        Duration of one stroke of the shoulder, s.
    strokes : int
    commands : Array
        In the drives' own units, (N, 2).

    """

    stroke: float
    strokes: int
    commands: Array


def standard_move(robot: Robot, strokes: int = STROKES) -> Move:
    """
    Return minimum-jerk strokes of 0.5 rad, of 1 s or as much longer as the drives require.

    The commands are computed for a rigid arm, so that any kind of drive makes about the same move.

    Raises
    ------
    InputError
        The move has more samples than a log in a CSV file may have.

    """
    stroke = STROKE
    while True:
        commands = _commands(robot, stroke, strokes)
        limits = [drive.command_limit for drive in robot.drives]
        if np.all(np.abs(commands) <= limits) or stroke > SLOWEST:
            return Move(stroke, strokes, np.clip(commands, np.negative(limits), limits))
        stroke *= SLOWER


def _commands(robot: Robot, stroke: float, strokes: int) -> Array:
    count = round(strokes * stroke / robot.sample_time)
    if count > MAX_SAMPLES:
        raise InputError(f'strokes: expected at most {MAX_SAMPLES} samples in all, got {strokes} '
                         f'strokes of {stroke:g} s, {count} samples')
    time = np.asarray(robot.sample_time * (np.arange(count) + 0.5), dtype=float)
    speed, acceleration = np.stack(
        [_profile(time, stroke), _profile(time, ELBOW_SHARE * stroke)], axis=-1)
    inertia = assumed_modes(robot, 1).mass_at(1.0, robot.payload_mass)[:2, :2]
    damping = np.array([drive.damping for drive in robot.drives])
    gain = np.array([drive.torque_gain for drive in robot.drives])
    return (speed * damping + acceleration @ inertia) / gain


def _profile(time: Array, stroke: float) -> tuple[Array, Array]:
    """Return speed and acceleration at times (N,), s, of strokes 10 s^3 - 15 s^4 + 6 s^5."""
    s = time / stroke % 1.0
    # The first stroke goes only from the middle to one side.
    sign = np.where((time // stroke).astype(int) % 2 == 0, 1.0, -1.0)
    sign[time < stroke] = 0.5
    size = 2.0 * AMPLITUDE * sign
    speed = size * 30.0 * s**2 * (1.0 - s)**2 / stroke
    acceleration = size * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / stroke**2
    return speed, acceleration


def simulated_move(robot: Robot, strokes: int, modes: int, seed: int) -> Log:
    """Return the log of the standard move by the simulated arm with noisy sensors."""
    move = standard_move(robot, strokes)
    arm = ExtendedArm(robot, 'assumed_modes', modes, effects=nominal_effects(robot))
    noise = Noise(robot.angle_noise, robot.strain_noise)
    output, velocity = simulate(Simulator(arm, noise=noise, seed=seed), move.commands)
    time = np.asarray(robot.sample_time * np.arange(len(output)), dtype=float)
    return Log(f'{robot.name}, standard move', time, move.commands, output[:, :2], output[:, 2:],
               robot.gauge_names, velocity)
