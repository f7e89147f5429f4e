"""
The standard move, in which both joints swing smoothly to and fro.

The observability bound and simulated logs use it; `flex_robot move` writes it for the real arm,
which follows the commands from where it stands: they know nothing of its angles.
"""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.assumed_modes import assumed_modes
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_keys import DRIVES
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.logs.csv_table import MAX_BYTES
from flex_plant_sim.logs.log import Log
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.nominal import nominal_effects
from flex_plant_sim.simulation.simulator import Noise, simulate, Simulator
from msg_config.errors import InputError
import numpy as np

# Largest amplitude, rad, and duration, s, of a stroke: 0.5 rad from side to side, during which
# the links of a bench arm swing about twice.
AMPLITUDE, STROKE = 0.25, 1.0
# Room to either side over the amplitude: what a joint turns by follows the drive's gain or its
# friction, and a real one may have half of the friction that its file says.
ROOM = 2.0
# Least swing from side to side, rad, as docs/logs.md asks for.
LEAST_SWING = 0.3
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
# Output, rad or m/m, from which the simulation has diverged; its square is still finite.
DIVERGED = 1e6


@dataclass(frozen=True)
class Move:
    """
    The commands of a move.

    Attributes
    ----------
    centre, amplitude : Array
        Angles at which the joints must begin, at rest, and by how much they swing to either side,
        rad, (2,).
    stroke : float
        Duration of one stroke of the shoulder, s.
    strokes : int
    commands : Array
        In the drives' own units, (N, 2).

    """

    centre: Array
    amplitude: Array
    stroke: float
    strokes: int
    commands: Array


def standard_move(robot: Robot, strokes: int = STROKES) -> Move:
    """
    Return minimum-jerk strokes of 0.5 rad, of 1 s or as much longer as the drives require.

    They are about 0 rad, or as near to it as the angle limits leave room; between narrow limits
    they are shorter.

    The commands are computed for a rigid arm, so that any kind of drive makes about the same move.

    Raises
    ------
    InputError
        The move has more samples than a log in a CSV file may have.

    """
    low, high = np.array(robot.angle_limits).T
    amplitude = np.minimum(AMPLITUDE, (high - low) / (2.0 * ROOM))
    centre, stroke = np.clip(np.zeros(2), low + ROOM * amplitude, high - ROOM * amplitude), STROKE
    while True:
        commands = _commands(robot, centre, amplitude, stroke, strokes)
        limits = [drive.command_limit for drive in robot.drives]
        if np.all(np.abs(commands) <= limits) or stroke > SLOWEST:
            return Move(centre, amplitude, stroke, strokes,
                        np.clip(commands, np.negative(limits), limits))
        stroke *= SLOWER


def _commands(robot: Robot, centre: Array, amplitude: Array, stroke: float, strokes: int
              ) -> Array:
    count = round(strokes * stroke / robot.sample_time)
    if count > MAX_SAMPLES:
        raise InputError(f'strokes: expected at most {MAX_SAMPLES} samples in all, got {strokes} '
                         f'strokes of {stroke:g} s, {count} samples')
    time = np.asarray(robot.sample_time * (np.arange(count) + 0.5), dtype=float)
    speed, acceleration = amplitude * np.stack(
        [_profile(time, stroke), _profile(time, ELBOW_SHARE * stroke)], axis=-1)
    inertia = assumed_modes(robot, 1).mass_at(np.cos(centre[1]), robot.payload_mass)[:2, :2]
    damping = np.array([drive.damping for drive in robot.drives])
    gain = np.array([drive.torque_gain for drive in robot.drives])
    return (speed * damping + acceleration @ inertia) / gain


def _profile(time: Array, stroke: float) -> tuple[Array, Array]:
    """Return speed and acceleration at times (N,), s, of strokes 2 (10 s^3 - 15 s^4 + 6 s^5)."""
    s = time / stroke % 1.0
    # The first stroke goes only from the middle to one side.
    sign = np.where((time // stroke).astype(int) % 2 == 0, 1.0, -1.0)
    sign[time < stroke] = 0.5
    size = 2.0 * sign
    speed = size * 30.0 * s**2 * (1.0 - s)**2 / stroke
    acceleration = size * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / stroke**2
    return speed, acceleration


def check_moved(output: Array, robot: Robot, modes: int) -> None:
    """Raise InputError that names the robot's payload where its simulated output diverged."""
    if not np.abs(output).max() < DIVERGED:
        raise InputError(f'{robot.source}: payload: expected one that the model moves, got '
                         f'{robot.payload_mass:.4g} kg: with {modes} modes it is unstable')


def simulated_move(robot: Robot, move: Move, modes: int, seed: int) -> Log:
    """
    Return the log of a move by the simulated arm with noisy sensors.

    Raises
    ------
    InputError
        The angle limits leave too little room for a log, the simulated arm passes them, or it
        diverges with its payload.

    """
    for name, (low, high) in zip(DRIVES, robot.angle_limits):
        # As limits are written: 0.1 and 0.7 are 0.6 apart.
        if round(high - low, 9) < ROOM * LEAST_SWING:
            raise InputError(f'{robot.source}: {name}.angle_limits_rad: expected at least '
                             f'{ROOM * LEAST_SWING:g} rad between them, a swing of '
                             f'{LEAST_SWING:g} rad and as much for safety, got {high - low:.4g}')
    arm = ExtendedArm(robot, 'assumed_modes', modes, effects=nominal_effects(robot))
    noise = Noise(robot.angle_noise, robot.strain_noise)
    simulator = Simulator(arm, noise=noise, seed=seed)
    simulator.begin_at(move.centre)
    with np.errstate(all='ignore'):
        output, _ = simulate(simulator, move.commands)
    check_moved(output, robot, modes)
    for name, angle, (low, high) in zip(DRIVES, output.T, robot.angle_limits):
        if not (low <= angle.min() and angle.max() <= high):
            raise InputError(f'{robot.source}: {name}.angle_limits_rad: expected a simulated '
                             f'move within {low:g} to {high:g} rad, got {angle.min():.4g} to '
                             f'{angle.max():.4g}')
    time = np.asarray(robot.sample_time * np.arange(len(output)), dtype=float)
    return Log(f'{robot.name}, standard move', time, move.commands, output[:, :2], output[:, 2:],
               robot.gauge_names)
