"""flex_replay: simulate a log from its commands and say how well the model does."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
import math
import sys
from typing import Any

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.logs.log import Log
from flex_plant_sim.simulation.agreement import fit_percent, rmse
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.nominal import has_coriolis, model_words, nominal_effects
from flex_plant_sim.simulation.simulator import simulate, Simulator
from flex_plant_sim.tools import command_line
from flex_plant_sim.tools.log_input import read_log_aloud
from flex_plant_sim.tools.outputs import check_image, check_outputs, results
from msg_config.errors import InputError
import numpy as np

# No arm turns or stretches so far: a simulation that does has diverged.
ANGLE_BEYOND_REASON = 1e3
STRAIN_BEYOND_REASON = 1.0


@dataclass(frozen=True)
class Replay:
    """
    A log and its simulation from the same commands.

    Attributes
    ----------
    log : Log
    arm : ExtendedArm
    simulated : Array
        Without noise, (N, m), columns as log.output.

    """

    log: Log
    arm: ExtendedArm
    simulated: Array

    @property
    def units(self) -> tuple[str, ...]:
        """Return the unit of every channel."""
        return ('rad', 'rad', *('m/m' for _ in self.log.gauge_names))

    @property
    def residual(self) -> Array:
        """Return measured minus simulated, (N, m)."""
        return self.log.output - self.simulated

    @property
    def fit_percent(self) -> Array:
        """Return the fit of every channel, %, (m,)."""
        return fit_percent(self.log.output, self.simulated)

    @property
    def rmse(self) -> Array:
        """Return the root mean square error of every channel, (m,)."""
        return rmse(self.log.output, self.simulated)

    def results(self) -> dict[str, Any]:
        """Return settings and figures for JSON; the fit of a channel at rest is null."""
        return {
            'log': self.log.source, 'samples': len(self.log),
            'duration_s': round(float(self.log.time[-1] - self.log.time[0]), 9),
            'robot': self.arm.robot.name, 'model': self.arm.model_name,
            'modes': self.arm.modes, 'payload_kg': self.arm.payload,
            'sample_time_s': self.log.sample_time,
            'effects': [f'{effect.identifier}:{effect.site}' for effect in self.arm.effects],
            'channels': {
                name: {'fit_percent': None if math.isnan(fit) else float(fit),
                       'rmse': float(error), 'unit': unit}
                for name, fit, error, unit in zip(self.log.output_names, self.fit_percent,
                                                  self.rmse, self.units)}}


def replay(log: Log, robot: Robot, model: str = 'assumed_modes', modes: int = 3,
           payload: float | None = None, coriolis: bool = True) -> Replay:
    """
    Simulate a log from its commands alone, the arm at rest at the log's first joint angles.

    The nominal effects act. The log's own sample time replaces the robot's.

    Parameters
    ----------
    log : Log
        Its commands drive the simulation.
    robot : Robot
        The arm, with its effects.
    model : str
        A key of extended_arm.MODELS.
    modes : int
        Modes a link.
    payload : float, optional
        kg, the robot's if not given.
    coriolis : bool
        See nominal_robot.

    Raises
    ------
    InputError
        If the simulation diverges.

    """
    robot = replace(robot, sample_time=log.sample_time)
    arm = ExtendedArm(robot, model, modes, payload,
                      nominal_effects(robot, model, coriolis))
    simulator = Simulator(arm)
    at_zero = arm.output(simulator.state, 0.0)[:2]
    simulator.state[:2] = log.joint[0] - at_zero
    # What overflows is reported below, once.
    with np.errstate(all='ignore'):
        simulated, _ = simulate(simulator, log.command)
    _check_bounded(log, arm, simulated)
    return Replay(log, arm, simulated)


def _check_bounded(log: Log, arm: ExtendedArm, simulated: Array) -> None:
    limits = np.array([ANGLE_BEYOND_REASON] * 2 + [STRAIN_BEYOND_REASON] * log.strain.shape[1])
    fault = ~(np.abs(simulated) < limits)
    if fault.any():
        k, channel = (int(index) for index in np.argwhere(fault)[0])
        pole = float(np.linalg.eigvals(arm.plant.a).real.max())
        raise InputError(
            f'{arm.robot.name}: the model {arm.model_name} with {arm.modes} modes and '
            f'{arm.payload:g} kg is unstable: {log.output_names[channel]} passes '
            f'{limits[channel]:g} after {log.time[k] - log.time[0]:g} s (fastest growing pole '
            f'{pole:+.3g} 1/s)')


def fit_text(fit: float) -> str:
    """Return a fit as text; a channel at rest has none."""
    return 'channel at rest' if math.isnan(fit) else f'fit {fit:.1f} %'


def table(result: Replay) -> str:
    """Return the figures as text."""
    log, arm = result.log, result.arm
    words = model_words(arm.robot.name, arm.model_name, arm.modes, has_coriolis(arm.effects))
    lines = [f'{log.source}: {len(log)} samples at {1.0 / log.sample_time:g} Hz; '
             f'{words}, {arm.payload:g} kg',
             f'{"channel":<12}{"":>16}{"RMSE":>12}']
    for name, fit, error, unit in zip(log.output_names, result.fit_percent, result.rmse,
                                      result.units):
        lines.append(f'{name:<12}{fit_text(fit):>16}{error:>12.3g} {unit}')
    return '\n'.join(lines)


def options() -> argparse.ArgumentParser:
    """Return the options of flex_replay."""
    parser = command_line.parser('Simulate a log from its commands; print fit and RMSE.')
    command_line.add_log_argument(parser)
    command_line.add_arm_arguments(parser)
    command_line.add_coriolis_argument(parser)
    command_line.add_json_argument(parser)
    parser.add_argument('--plot', default=None, metavar='FILE',
                        help='plot measured, simulated and residual (PNG, PDF, SVG)')
    return parser


def _main(arguments: argparse.Namespace) -> None:
    check_outputs({'--json': arguments.json, '--plot': arguments.plot},
                  [arguments.log, arguments.robot])
    if arguments.plot:
        check_image(arguments.plot)
    robot = load_robot(arguments.robot)
    coriolis = not arguments.no_coriolis
    forces = has_coriolis(nominal_effects(robot, arguments.model, coriolis))
    log = read_log_aloud(arguments.log, robot, arguments.model, arguments.modes, forces)
    result = replay(log, robot, arguments.model, arguments.modes, arguments.payload, coriolis)
    with results() as write:
        write(print, table(result))
        if arguments.json:
            write(command_line.write_json, arguments.json, result.results())
        if arguments.plot:
            from flex_plant_sim.tools.replay_plot import write_plot
            write(write_plot, arguments.plot, result)


def main(argv: Sequence[str] | None = None) -> int:
    """Run flex_replay."""
    return command_line.run(lambda: _main(options().parse_args(argv)))


if __name__ == '__main__':
    sys.exit(main())
