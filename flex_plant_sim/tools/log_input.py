"""Reading a log in a tool: says what was done with it, and what does not look like the arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import sys

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.inputs.plausible import channel_hints
from flex_plant_sim.logs.log import Log
from flex_plant_sim.logs.read import read_log
from flex_plant_sim.logs.rows import SAMPLING_AGREES
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.nominal import beyond_checked, has_coriolis, nominal_effects
from flex_plant_sim.simulation.simulator import simulate, Simulator
from msg_config.errors import InputError
import numpy as np

# A few swings of the slowest mode; signs and units show within them.
HINT_DURATION = 10.0


def read_log_aloud(path: str, robot: Robot, model: str, modes: int,
                   coriolis: bool | None = None) -> Log:
    """
    Return a log, and say on stderr, a line each, what a user must know before believing it.

    That is what was done to read it, what made it where that is another model, joints faster
    than the models are checked for, and channels whose unit or sign looks wrong beside a
    simulation from the same commands. Whether Coriolis forces act, None leaves open.

    Raises
    ------
    InputError
        It cannot be read; with file and row, column or topic.

    """
    log = read_log(path, robot)
    said = (*log.notes, _other_origin(log, robot, model, modes, coriolis),
            beyond_checked(log.time, log.joint), *hints(log, robot))
    for line in filter(None, said):
        print(f'{log.source}: {line}', file=sys.stderr)
    return log


def read_logs(paths: Sequence[str], robot: Robot, model: str, modes: int,
              coriolis: bool = True) -> list[Log]:
    """
    Return the logs, all sampled alike.

    Raises
    ------
    InputError
        Naming the file that cannot be read, is sampled otherwise, or is no evidence of the arm.

    """
    forces = has_coriolis(nominal_effects(robot, model, coriolis))
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


def hints(log: Log, robot: Robot) -> tuple[str, ...]:
    """Return which channels of a log look as if their unit or sign were another."""
    part = log.part(0, min(len(log), round(HINT_DURATION / log.sample_time)))
    if len(part) < 3 or not part.command.any():
        return ()
    robot = replace(robot, sample_time=log.sample_time)
    try:
        with np.errstate(all='ignore'):
            simulator = Simulator(ExtendedArm(robot, 'assumed_modes', 1, None,
                                              nominal_effects(robot)))
            simulator.state[:2] = part.joint[0]
            expected, _ = simulate(simulator, part.command)
    except (InputError, np.linalg.LinAlgError):
        return ()
    if not np.isfinite(expected).all():
        return ()
    units = ('rad', 'rad', *('m/m' for _ in log.gauge_names))
    noise = np.where(np.array(units) == 'rad', robot.angle_noise, robot.strain_noise)
    return channel_hints(part.output, expected, log.output_names, units, noise)
