"""Reads a log for a tool and reports what was done to it and what does not look like the arm."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
import sys

from flex_plant_sim.arm.assumed_modes import assumed_modes
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.commissioning.summary import locked_modes
from flex_plant_sim.effects.mechanics.gauge import gauge_places
from flex_plant_sim.effects.mechanics.kinematics import end_rotations
from flex_plant_sim.inputs.plausible import (
    channel_hints,
    inverted,
    reversal_gain,
    REVERSED,
    SAMPLING_AGREES,
    WRONG_SCALE,
)
from flex_plant_sim.logs.log import Log
from flex_plant_sim.logs.read import read_log, stored_at
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.nominal import beyond_checked, has_coriolis, nominal_effects
from flex_plant_sim.simulation.simulator import simulate, Simulator
from msg_config.errors import InputError
import numpy as np

# Duration that is compared with a simulation, s: a few swings of the slowest mode, enough to show
# wrong signs and units.
HINT_DURATION = 10.0
# Angle by which bending turns a link's end, rad, from which on its square is told: 9 %.
FAR_BENT = 0.3
# Modes per link of the shape in which links are taken to bend.
BENT_MODES = 3


def read_log_aloud(path: str, robot: Robot, model: str, modes: int,
                   coriolis: bool | None) -> Log:
    """
    Return a log, and print to stderr, one line each, what a user must know before trusting it.

    The robot carries what the user says that it does, see command_line.carrying.
    This is what was done to read it, its origin if that is another model, joints faster than the
    models are checked for, links that bend further than they hold for, and channels whose unit or
    sign looks wrong in comparison with a simulation from the same commands; the log's notes hold
    the same lines. `coriolis` is None if it is open whether these forces act.

    Raises
    ------
    InputError
        The log cannot be read; names file and row, column or topic.

    """
    log = read_log(path, robot)
    wrong = hints(log, robot)
    # What strain in a wrong unit says of bending would be nonsense.
    said = tuple(filter(None, (
        *log.notes, _other_origin(log, robot, model, modes, coriolis),
        beyond_checked(log.time, log.joint), '' if wrong else far_bent(log.strain, robot),
        *wrong)))
    for line in said:
        print(f'{log.source}: {line}', file=sys.stderr)
    return replace(log, notes=said, misread=(*log.misread, *wrong))


def read_logs(paths: Sequence[str], robot: Robot, model: str, modes: int,
              coriolis: bool = True) -> list[Log]:
    """
    Return several logs with the same sampling interval.

    Raises
    ------
    InputError
        A log cannot be read, is sampled differently, or is no evidence of the arm; names the
        file.

    """
    forces = has_coriolis(nominal_effects(robot, model, coriolis))
    places = [stored_at(path) for path in paths]
    for k, path in enumerate(paths):
        same = [other for other, place in zip(paths[:k], places) if place & places[k]]
        if same:
            raise InputError(f'{path}: expected each log once, got what {same[0]} holds')
    logs = [read_log_aloud(path, robot, model, modes, forces) for path in paths]
    for log in logs:
        if log.doubts:
            raise InputError(f'{log.source}: not diagnosed: {log.doubts[0]}')
    for log in logs[1:]:
        if abs(log.sample_time - logs[0].sample_time) > SAMPLING_AGREES * logs[0].sample_time:
            raise InputError(f'{log.source}: expected a sample time of {logs[0].sample_time:g} s '
                             f'as in {logs[0].source}, got {log.sample_time:g} s')
    return logs


def _other_origin(log: Log, robot: Robot, model: str, modes: int,
                  coriolis: bool | None) -> str:
    return '' if log.origin is None else log.origin.against(robot.name, model, modes, coriolis)


def bending_angles(strain: Array, robot: Robot) -> Array:
    """
    Return the angles by which bending turns the ends of the links, rad, (N, 2).

    Each follows from the link's gauges (N, G) as in the arm's first mode with the joints held, to
    8 % of finite elements', and counts from the median; of a link without gauges it is 0.
    """
    shape = locked_modes(robot, BENT_MODES, robot.payload_mass)[1][:, 0]
    form = assumed_modes(robot, BENT_MODES)
    gauges, ends = form.strain[:, 2:] @ shape, end_rotations(form, robot)[:, 2:] @ shape
    found = np.zeros((len(strain), 2))
    for k, end in enumerate(ends):
        own = gauge_places(robot, f'link_{k + 1}')
        found[:, k] = strain[:, own] @ np.linalg.pinv(gauges[own, None])[0] * end
    return np.asarray(found - np.median(found, axis=0))


def far_bent(strain: Array, robot: Robot) -> str:
    """Return a one-line warning if links bend further than the models hold for, else ''."""
    # One sample in a hundred may be a gauge's fault.
    angles = np.percentile(np.abs(bending_angles(strain, robot)), 99.0, axis=0)
    k = int(np.argmax(angles))
    if not angles[k] > FAR_BENT:
        return ''
    return (f'link {k + 1} bends by {angles[k]:.2g} rad: the models are of first order in that '
            f'angle and err by its square, {100.0 * angles[k]**2:.0f} %')


def hints(log: Log, robot: Robot) -> tuple[str, ...]:
    """Return hints on channels of a log whose unit or sign looks wrong, or with no command."""
    part = log.part(0, min(len(log), round(HINT_DURATION / log.sample_time)))
    if len(part) < 3:
        return ()
    robot = replace(robot, sample_time=log.sample_time)
    expected = _expected(robot, part.joint[0], part.command)
    if expected is None:
        return ()
    noise = np.where(np.array(robot.output_units) == 'rad', robot.angle_noise, robot.strain_noise)
    # What follows from a command that was not logged would be taken for wrong units and signs.
    uncommanded = tuple(command_hints(part, expected, noise))
    if uncommanded or not part.command.any():
        return uncommanded
    reversed_joint, expected = _reversed_joint(part, robot, expected)
    return (*reversed_joint,
            *channel_hints(part.output, expected, log.output_names, robot.output_units, noise))


def _expected(robot: Robot, joint: Array, command: Array) -> Array | None:
    """Return the outputs, (N, m), of an arm that begins at joint angles; None where it cannot."""
    try:
        with np.errstate(all='ignore'):
            simulator = Simulator(ExtendedArm(robot, 'assumed_modes', 1, None,
                                              nominal_effects(robot)))
            simulator.begin_at(joint)
            expected, _ = simulate(simulator, command)
    except (InputError, np.linalg.LinAlgError):
        return None
    return expected if np.isfinite(expected).all() else None


def _reversed_joint(log: Log, robot: Robot, expected: Array) -> tuple[tuple[str, ...], Array]:
    """
    Return a hint if one joint looks counted the other way round, and what is expected then.

    Angle and command agree with each other all the same; the strain tells. An arm and its mirror
    image read alike but for the signs of all strains, so that joint 1 is meant where reversing
    joint 2 inverts most of them.
    """
    reverse = np.array([1.0, -1.0])
    other = _expected(robot, reverse * log.joint[0], reverse * log.command)
    if other is None:
        return (), expected
    other[:, 1] *= -1.0
    gain = reversal_gain(log.output, expected, other)
    if not gain > REVERSED:
        return (), expected
    joint = int(inverted(log.output, other)[2:].mean() <= 0.5)
    if joint == 0:
        other[:, 2:] *= -1.0
    name = log.output_names[joint]
    return (f'{name}: with angle and command counted the other way round the strain is explained '
            f'{gain:.2g} times better: are the signs of both inverted?',), other


def command_hints(log: Log, expected: Array, noise: Array) -> Iterator[str]:
    """Yield a hint for each joint that turns, though its command never changes."""
    turned, modelled = np.ptp(log.joint, axis=0), np.ptp(expected[:, :2], axis=0)
    for k, still in enumerate(np.ptp(log.command, axis=0) == 0.0):
        if still and turned[k] > WRONG_SCALE * (modelled[k] + noise[k]):
            yield (f'joint_{k + 1} turns by {turned[k]:.2g} rad, and its command never changes: '
                   'is it logged?')
