"""flex_robot: work on a robot file: template, check, drawing, prior, move, calibration, URDF."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
import math
from pathlib import Path
import sys

from flex_plant_sim.arm.models import DEFAULT_MODES
from flex_plant_sim.arm.robot_file import built_in_robots, load_robot, robot_text
from flex_plant_sim.arm.robot_text import with_numbers
from flex_plant_sim.atomic_file import MARK, whole_file
from flex_plant_sim.commissioning.calibrated_robot import calibrated_robot, calibration_text
from flex_plant_sim.commissioning.calibration import calibrate, MODEL, MODES
from flex_plant_sim.commissioning.check import Check
from flex_plant_sim.commissioning.drawing import write_drawing
from flex_plant_sim.commissioning.standard_move import simulated_move, standard_move
from flex_plant_sim.commissioning.template import reference_page, template
from flex_plant_sim.commissioning.urdf import urdf
from flex_plant_sim.diagnosis.likelihood.prior import prior_table
from flex_plant_sim.diagnosis.record.windows import LEAST_PERIODS
from flex_plant_sim.diagnosis.verdict.verdict import needed_duration, nominal_base
from flex_plant_sim.logs.csv_log import write_csv
from flex_plant_sim.simulation.replay import replay
from flex_plant_sim.tools import command_line
from flex_plant_sim.tools.log_input import read_logs
from flex_plant_sim.tools.outputs import check_image, check_outputs
from msg_config.errors import InputError
from msg_config.input_mapping import JOINTS

# Strokes of a log: half a minute, as docs/logs.md asks for. Of ten seconds `calibrate` and
# flex_diagnose refuse the reference arm's.
LOG_STROKES = 30
# How much longer a log is than flex_diagnose needs: it may be told a heavier payload.
MARGIN = 1.1


def _print_or_write(text: str, path: str | None) -> None:
    if path is None:
        print(text, end='')
        return
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding='utf-8')


def _template(arguments: argparse.Namespace) -> None:
    _print_or_write(template(), arguments.output)


def _reference(arguments: argparse.Namespace) -> None:
    _print_or_write(reference_page(), arguments.output)


def _check(arguments: argparse.Namespace) -> None:
    check_outputs({'--json': arguments.json}, [arguments.file])
    robot = command_line.carrying(load_robot(arguments.file), arguments.payload)
    found = Check.of(robot, arguments.modes)
    print(found.text())
    if arguments.json:
        command_line.write_json(arguments.json, found.results())


def _urdf(arguments: argparse.Namespace) -> None:
    if arguments.output is not None:
        check_outputs({'--output': arguments.output}, [arguments.file])
    text = urdf(load_robot(arguments.file), arguments.prefix)
    _print_or_write(f'{text}<!-- {MARK} -->\n', arguments.output)


def _show(arguments: argparse.Namespace) -> None:
    check_image(arguments.output)
    check_outputs({'--output': arguments.output}, [arguments.file])
    write_drawing(arguments.output, load_robot(arguments.file), arguments.modes)
    print(f'drawing: {arguments.output}')


def _prior(arguments: argparse.Namespace) -> None:
    print(prior_table(load_robot(arguments.file)))


def _move(arguments: argparse.Namespace) -> None:
    if Path(arguments.output).suffix != '.csv':
        raise InputError(f'--output: {arguments.output}: expected a name that ends with .csv, as '
                         'logs do')
    check_outputs({'--output': arguments.output}, [arguments.file])
    robot = command_line.carrying(load_robot(arguments.file), arguments.payload)
    needed = needed_duration(nominal_base(robot, MODEL, MODES))
    stroke = standard_move(robot, LOG_STROKES).stroke
    strokes = arguments.strokes or max(LOG_STROKES, math.ceil(MARGIN * needed / stroke))
    move = standard_move(robot, strokes)
    log = simulated_move(robot, move, arguments.modes, arguments.seed)
    write_csv(arguments.output, log, robot.inputs)
    if len(log) * robot.sample_time < needed:
        print(f'{arguments.output}: {len(log) * robot.sample_time:.1f} s, flex_diagnose needs '
              f'{needed:.1f} s, {LEAST_PERIODS} periods of the slowest mode', file=sys.stderr)
    print(f'commands, and what the arm should measure: {arguments.output}')
    print('begin at rest, with ' + ', '.join(
        f'{name} at {centre:.3g} rad (it swings by {amplitude:.3g} rad to either side)'
        for name, centre, amplitude in zip(JOINTS, move.centre, move.amplitude)))


def _calibrate(arguments: argparse.Namespace) -> None:
    check_outputs({'--output': arguments.output}, [arguments.robot, *arguments.log])
    robot = load_robot(arguments.robot)
    logs = read_logs(arguments.log, command_line.carrying(robot, arguments.payload), MODEL, MODES)
    found = calibrate(logs, robot, arguments.payload, lambda: print(
        f'fitting the parts to {sum(map(len, logs))} samples, half a minute for 4000',
        file=sys.stderr))
    text = with_numbers(robot_text(arguments.robot), calibrated_robot(robot, found))
    before, after = ([replay(log, item, payload=arguments.payload) for log in logs]
                     for item in (robot, found.robot))
    print(calibration_text(found))
    print(f'\n{"replay":<24}{"before":>10}{"after":>10}')
    for log, old, new in zip(logs, before, after):
        for name, a, b in zip(log.output_names, old.fit_percent, new.fit_percent):
            print(f'  {name:<22}{a:>8.1f} %{b:>8.1f} %')
    with whole_file(arguments.output) as temporary:
        temporary.write_text(text, encoding='utf-8')
    print(f'calibrated robot: {arguments.output}')


def _add_file(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('file', metavar='FILE',
                        help=f'robot file, or one of {", ".join(built_in_robots())}')


def _add_output(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--output', default=None, metavar='FILE',
                        help='where to write; the screen if not given')


def _add_modes(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--modes', default=DEFAULT_MODES, type=command_line.modes_number,
                        metavar='N', help='flexible modes a link, 1 to 20')


def _add_payload(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--payload', default=None, type=command_line.mass, metavar='KG',
                        help="payload mass; the robot file's if not given")


def _prefix(text: str) -> str:
    if text and not (text.isascii() and text.replace('_', '').replace('/', '').isalnum()):
        raise argparse.ArgumentTypeError(f'expected letters, digits, _ and /, got {text!r}')
    return text


Run = Callable[[argparse.Namespace], None]
Add = Callable[[str, Run, str], argparse.ArgumentParser]


def options() -> argparse.ArgumentParser:
    """Return the options of flex_robot."""
    parser = command_line.parser('Make, check and calibrate a robot file of your own arm.')
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')

    def add(name: str, run: Run, words: str) -> argparse.ArgumentParser:
        found: argparse.ArgumentParser = commands.add_parser(
            name, help=words, description=words, formatter_class=command_line.DefaultsShown)
        found.set_defaults(run=run)
        return found

    _add_output(add('template', _template, 'a robot file with a comment for every key'))
    _add_output(add('reference', _reference, 'the docs page of the robot file'))
    _add_check(add)
    _add_show(add)
    _add_move(add)
    _add_calibrate(add)
    _add_urdf(add)
    _add_file(add('prior', _prior, 'how far parts may be from the file, and effects from nothing'))
    return parser


def _add_check(add: Add) -> None:
    check = add('check', _check, 'plausibility, frequencies, gauges, what a log could tell')
    _add_file(check)
    _add_modes(check)
    _add_payload(check)
    command_line.add_json_argument(check)


def _add_show(add: Add) -> None:
    show = add('show', _show, 'a drawing of the arm with its first mode shapes')
    _add_file(show)
    _add_modes(show)
    show.add_argument('--output', required=True, metavar='FILE', help='PNG, SVG or PDF')


def _add_move(add: Add) -> None:
    move = add('move', _move, 'a log of the standard move: commands to play on the arm, and what '
               'it should measure')
    _add_file(move)
    _add_modes(move)
    _add_payload(move)
    move.add_argument('--strokes', default=None, type=command_line.count, metavar='N',
                      help='of 0.5 rad or what the angle limits leave, 1 s each or as slow as the '
                      'drives need; if not given, '
                      f'{LOG_STROKES}, or as many as flex_diagnose needs')
    move.add_argument('--seed', default=1, type=command_line.seed, metavar='N',
                      help='of the noise')
    move.add_argument('--output', required=True, metavar='FILE', help='CSV')


def _add_calibrate(add: Add) -> None:
    fit = add('calibrate', _calibrate, 'the parts of an arm from a log with a known payload')
    command_line.add_log_argument(fit, '+')
    fit.add_argument('--robot', required=True, metavar='FILE', help='robot file to start from')
    fit.add_argument('--payload', required=True, type=command_line.mass, metavar='KG',
                     help='what the arm carried, weighed')
    fit.add_argument('--output', required=True, metavar='NEW', help='the robot file to write')


def _add_urdf(add: Add) -> None:
    skeleton = add('urdf', _urdf, 'the rigid skeleton for robot_state_publisher')
    _add_file(skeleton)
    _add_output(skeleton)
    skeleton.add_argument('--prefix', default='', type=_prefix, metavar='P',
                          help='before the name of every link and frame')


def main(argv: Sequence[str] | None = None) -> int:
    """Run flex_robot."""
    arguments = options().parse_args(argv)
    return command_line.run(lambda: arguments.run(arguments))


if __name__ == '__main__':
    sys.exit(main())
