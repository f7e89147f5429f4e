"""The common part of all command-line tools: options, one-line errors, exit codes."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import replace
import errno
from functools import cache
import gc
import io
import json
import math
import os
from pathlib import Path
import sys
from typing import Any, NoReturn

from flex_plant_sim import tools
from flex_plant_sim.arm.file_section import PLAUSIBLE
from flex_plant_sim.arm.models import DEFAULT_MODEL, DEFAULT_MODES, MODELS
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import built_in_robots
from flex_plant_sim.atomic_file import AUTHOR, whole_file
from flex_plant_sim.quiet_signals import INTERRUPTED, interruptible
from flex_plant_sim.simulation.nominal import nominal_robot, WITH_CORIOLIS
from flex_plant_sim.tools.outputs import forget_standard_output
from msg_config.errors import BAD_INPUT, InputError, MACHINE, UNFORESEEN

# Errors of a machine that may do the same later. A damaged file raises further ones.
MACHINE_ERRORS = (errno.EACCES, errno.EAGAIN, errno.EDQUOT, errno.EIO, errno.EMFILE, errno.ENFILE,
                  errno.ENOMEM, errno.ENOSPC, errno.EROFS, errno.ESTALE, errno.ETIMEDOUT)
TRACEBACK = 'FLEX_TRACEBACK'
# Largest payload, kg, as in a robot file.
LARGEST_MASS = PLAUSIBLE['mass_kg'][1]


class StoreOnce(argparse.Action):
    """Store the value of an option, which may be given once: who gives two means another one."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: argparse.Namespace,
                 values: Any, option_string: str | None = None) -> None:
        """Store the value; report an option that has one."""
        given = parser.given if isinstance(parser, OneLineParser) else set()
        if self.option_strings and self.dest in given:
            raise argparse.ArgumentError(self, 'expected once, given again')
        given.add(self.dest)
        setattr(namespace, self.dest, values)


class OneLineParser(argparse.ArgumentParser):
    """A parser that reports a bad option in one line, like any other bad input."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self.given: set[str] = set()
        for name in (None, 'store'):
            self.register('action', name, StoreOnce)

    def parse_known_args(self, *arguments: Any, **settings: Any) -> Any:
        """Parse with no option given yet."""
        self.given = set()
        return super().parse_known_args(*arguments, **settings)

    def error(self, message: str) -> NoReturn:
        """Print the message and exit with code 2."""
        self.exit(BAD_INPUT, f'error: {message} (see {self.prog} --help)\n')


class DefaultsShown(argparse.ArgumentDefaultsHelpFormatter):
    """A help formatter that shows the default of an option if it has one."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        shown = action.default not in (None, False, '', []) and not action.required
        return super()._get_help_string(action) if shown else action.help


def parser(description: str) -> argparse.ArgumentParser:
    """Return a parser whose help shows defaults."""
    return OneLineParser(description=description, formatter_class=DefaultsShown)


def add_log_argument(options: argparse.ArgumentParser, nargs: str | None = None) -> None:
    """Add LOG (with nargs '+': LOG…)."""
    options.add_argument('log', metavar='LOG', nargs=nargs,
                         help='CSV file, or rosbag2 (sqlite3, MCAP) folder or file')


def add_arm_arguments(options: argparse.ArgumentParser, modes: int = DEFAULT_MODES,
                      payload: bool = True) -> None:
    """Add --robot, --model, --modes and, if `payload`, --payload."""
    options.add_argument('--robot', default='reference', metavar='NAME|FILE',
                         help=f'{", ".join(built_in_robots())} or a YAML file')
    options.add_argument('--model', default=DEFAULT_MODEL, choices=sorted(MODELS),
                         help='arm model')
    options.add_argument('--modes', default=modes, type=modes_number, metavar='N',
                         help='flexible modes a link, 1 to 20')
    if not payload:
        return
    options.add_argument('--payload', default=None, type=mass, metavar='KG',
                         help="payload mass; the robot file's if not given")


def add_coriolis_argument(options: argparse.ArgumentParser) -> None:
    """Add --no-coriolis."""
    options.add_argument('--no-coriolis', action='store_true',
                         help='leave Coriolis and centripetal forces out of the model, as those '
                              'of the paper do; what the robot file names stays')


def check_coriolis(arguments: argparse.Namespace, robot: Robot) -> None:
    """Raise InputError where --no-coriolis would change nothing."""
    with_forces, without = (nominal_robot(robot, arguments.model, coriolis)
                            for coriolis in (True, False))
    if arguments.no_coriolis and with_forces == without:
        why = f'the robot file {robot.source} names these forces, which stay' \
            if arguments.model in WITH_CORIOLIS else f'--model {arguments.model} has none'
        raise InputError(f'--no-coriolis: expected a model with forces to leave out: {why}')


def carrying(robot: Robot, payload: float | None) -> Robot:
    """Return the robot with the payload that a user tells, kg; None if that is the file's."""
    return robot if payload is None else replace(robot, payload_mass=payload)


def add_json_argument(options: argparse.ArgumentParser) -> None:
    """Add --json."""
    options.add_argument('--json', default=None, metavar='FILE', help='write the results as JSON')


def modes_number(text: str) -> int:
    """Return a number of modes, 1 to 20."""
    if not 1 <= _integer(text) <= 20:
        raise argparse.ArgumentTypeError(f'expected a whole number from 1 to 20, got {text!r}')
    return int(text)


def count(text: str) -> int:
    """Return an integer from 1 to a million."""
    if not (1 <= _integer(text) <= 10**6):
        raise argparse.ArgumentTypeError(f'expected a whole number from 1 to 1e6, got {text!r}')
    return int(text)


def processes(text: str) -> int:
    """Return a number of processes, 1 to 1000: more would only exhaust the machine."""
    if not (1 <= _integer(text) <= 1000):
        raise argparse.ArgumentTypeError(f'expected a whole number from 1 to 1000, got {text!r}')
    return int(text)


def seed(text: str) -> int:
    """Return the seed of a random number generator."""
    if not (0 <= _integer(text) < 2**32):
        raise argparse.ArgumentTypeError(
            f'expected a whole number from 0 to 2^32 - 1, got {text!r}')
    return int(text)


def _integer(text: str) -> int:
    """Return an integer of at most ten digits; -1 for any other text."""
    return int(text) if text.isascii() and text.isdigit() and len(text) <= 10 else -1


def number(text: str) -> float:
    """Return a number; NaN for any other text."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def mass(text: str) -> float:
    """Return a mass, kg, not negative and at most the largest in a robot file."""
    value = number(text)
    if not 0.0 <= value <= LARGEST_MASS:
        raise argparse.ArgumentTypeError(
            f'expected a mass >= 0 kg, at most {LARGEST_MASS:g} kg, got {text!r}')
    return value


@cache
def package_version() -> str:
    """Return the version of the package, which need not be installed."""
    # Takes as long to import as all else here.
    from importlib.metadata import PackageNotFoundError, version
    try:
        return version(AUTHOR)
    except PackageNotFoundError:
        return 'not installed'


def write_json(path: str | Path, results: Mapping[str, Any]) -> None:
    """
    Write results as JSON, whole or not at all; a number that is not finite becomes null.

    Raises
    ------
    InputError
        Nothing can be written there.

    """
    text = json.dumps(_finite({'written_by': AUTHOR, **results}), indent=2, allow_nan=False)
    with whole_file(path) as temporary:
        temporary.write_text(text + '\n', encoding='utf-8')


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def run(main: Callable[[], int | None]) -> int:
    """
    Run a tool and return its exit code: its own or 0, 2 after bad input, 130 after a signal.

    It is 75 where the machine failed: memory, room, rights or a package are missing. Any error is
    reported in one line on stderr. The signals are Ctrl-C, SIGTERM and SIGHUP. An
    unforeseen error gives 1; its traceback is shown if the environment variable FLEX_TRACEBACK is
    set.
    """
    _replace_unencodable()
    if tools.IN_OWN_PROCESS:
        # What is imported stays: looking there for garbage takes 7 % of the time of a search.
        gc.freeze()
    try:
        with interruptible():
            code = main() or 0
            sys.stdout.flush()
            return code
    except InputError as error:
        return _print_error(str(error), _code_of(error))
    except KeyboardInterrupt:
        return _print_error('interrupted', INTERRUPTED, '')
    except MemoryError:
        return _print_error('out of memory', MACHINE)
    except BrokenPipeError:
        forget_standard_output()
        return _print_error('standard output: nobody reads it any more', BAD_INPUT)
    except OSError as error:
        forget_standard_output()
        return _print_error(f'{error.filename or "standard output"}: {error.strerror or error}',
                            _code_of(error))
    except Exception as error:  # noqa: B902  a tool ends with a result or one line
        if os.environ.get(TRACEBACK):
            raise
        return _print_error(f'unforeseen {type(error).__name__}: {error} '
                            f'(set {TRACEBACK}=1 to see where)', UNFORESEEN)


def _code_of(error: BaseException | None) -> int:
    """Return the exit code of a bad input or of the machine's error that it was made of."""
    while error is not None:
        # Of a MemoryError, an InputError is made where a log needs more than any may.
        if isinstance(error, ImportError) or getattr(error, 'errno', None) in MACHINE_ERRORS:
            return MACHINE
        error = error.__cause__ or error.__context__
    return BAD_INPUT


def _replace_unencodable() -> None:
    """Let terminals and pipes that cannot encode a character such as ± show a question mark."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors != 'replace':
            stream.reconfigure(errors='replace')


def _print_error(line: str, code: int, prefix: str = 'error: ') -> int:
    try:
        print(prefix + str(InputError(line)), file=sys.stderr, flush=True)
    except OSError:  # nobody reads this either
        pass
    return code
