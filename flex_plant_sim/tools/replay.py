"""flex_replay: simulate a log from its commands and print how well the model agrees."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import sys

from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.simulation.nominal import has_coriolis, model_words, nominal_effects
from flex_plant_sim.simulation.replay import Replay, replay
from flex_plant_sim.tools import command_line
from flex_plant_sim.tools.log_input import read_log_aloud
from flex_plant_sim.tools.outputs import check_image, check_outputs, results
from flex_plant_sim.tools.replay_plot import fit_text, write_plot


def table(result: Replay) -> str:
    """Return the fit and error of every channel as text."""
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
    command_line.check_coriolis(arguments, robot)
    coriolis = not arguments.no_coriolis
    forces = has_coriolis(nominal_effects(robot, arguments.model, coriolis))
    log = read_log_aloud(arguments.log, command_line.carrying(robot, arguments.payload),
                         arguments.model, arguments.modes, forces)
    result = replay(log, robot, arguments.model, arguments.modes, arguments.payload, coriolis)
    if result.start_rates.any():
        print(f'{log.source}: begins in motion, at {result.start_rates[0]:.2g} and '
              f'{result.start_rates[1]:.2g} rad/s; how its links are bent then is not known, and '
              'their first swings are not simulated', file=sys.stderr)
    with results() as write:
        write(print, table(result))
        if arguments.json:
            write(command_line.write_json, arguments.json, result.results())
        if arguments.plot:
            write(_write_plot, arguments.plot, result)


def _write_plot(path: str, result: Replay) -> None:
    write_plot(path, result)
    print(f'plot: {path}')


def main(argv: Sequence[str] | None = None) -> int:
    """Run flex_replay."""
    return command_line.run(lambda: _main(options().parse_args(argv)))


if __name__ == '__main__':
    sys.exit(main())
