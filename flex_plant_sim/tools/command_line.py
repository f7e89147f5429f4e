"""What all command-line tools share: options, one-line errors, exit codes, whole files."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
import json
import math
from pathlib import Path
import sys
from typing import Any, NoReturn

from flex_plant_sim.arm.robot_file import built_in_robots
from flex_plant_sim.atomic_file import whole_file
from flex_plant_sim.simulation.extended_arm import MODELS
from msg_config.errors import InputError

BAD_INPUT, INTERRUPTED = 2, 130


class OneLineParser(argparse.ArgumentParser):
    """A parser that reports a bad option in one line, as every other bad input."""

    def error(self, message: str) -> NoReturn:
        """Print the message and exit with code 2."""
        self.exit(BAD_INPUT, f'error: {message} (see {self.prog} --help)\n')


def parser(description: str) -> argparse.ArgumentParser:
    """Return a parser that shows defaults."""
    return OneLineParser(
        description=description, formatter_class=argparse.ArgumentDefaultsHelpFormatter)


def add_log_argument(options: argparse.ArgumentParser, nargs: str | None = None) -> None:
    """Add LOG (with nargs '+': LOG…)."""
    options.add_argument('log', metavar='LOG', nargs=nargs,
                         help='CSV file, or rosbag2 (sqlite3, MCAP) folder or file')


def add_arm_arguments(options: argparse.ArgumentParser, model: str = 'assumed_modes',
                      modes: int = 3, payload: bool = True) -> None:
    """Add --robot, --model, --modes and, where it is asked for, --payload."""
    options.add_argument('--robot', default='reference', metavar='NAME|FILE',
                         help=f'{", ".join(built_in_robots())} or a YAML file')
    options.add_argument('--model', default=model, choices=sorted(MODELS), help='arm model')
    options.add_argument('--modes', default=modes, type=modes_number, metavar='N',
                         help='flexible modes a link, 1 to 20')
    if not payload:
        return
    options.add_argument('--payload', default=None, type=mass, metavar='KG',
                         help="payload mass; the robot file's if not given")


def add_json_argument(options: argparse.ArgumentParser) -> None:
    """Add --json."""
    options.add_argument('--json', default=None, metavar='FILE', help='write the results as JSON')


def modes_number(text: str) -> int:
    """Return a number of modes, 1 to 20."""
    if not (text.isdigit() and 1 <= int(text) <= 20):
        raise argparse.ArgumentTypeError(f'expected a whole number from 1 to 20, got {text!r}')
    return int(text)


def mass(text: str) -> float:
    """Return a mass, kg, finite and not negative."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= 0.0):
        raise argparse.ArgumentTypeError(f'expected a mass >= 0 kg, got {text!r}')
    return value


def output_folder(path: str | Path) -> Path:
    """
    Return a folder, made if need be.

    Raises
    ------
    InputError
        If it cannot be made.

    """
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f'{path}: expected a folder, got: {error}') from None
    return Path(path)


def write_json(path: str | Path, results: Mapping[str, Any]) -> None:
    """
    Write results as JSON, whole or not at all.

    Raises
    ------
    InputError
        If nothing can be written there.
    ValueError
        If a number is not finite: JSON has none such.

    """
    text = json.dumps(results, indent=2, allow_nan=False)
    with whole_file(path) as temporary:
        temporary.write_text(text + '\n', encoding='utf-8')


def run(main: Callable[[], int | None]) -> int:
    """
    Return a tool's exit code: its own or 0, 2 after bad input, 130 after Ctrl-C.

    Bad input is one line on stderr.
    """
    try:
        return main() or 0
    except InputError as error:
        print(f'error: {" ".join(str(error).split())}', file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print('interrupted', file=sys.stderr)
        return INTERRUPTED
