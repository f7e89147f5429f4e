"""
flex_diagnose: name what the simulation gets wrong, extend the model, measure the gain.

Logs go in; verdict, report, JSON and an extended robot file come out. The steps are those of
`flex_plant_sim/diagnosis/`; this file holds their order and the command line.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
import os
from pathlib import Path
from shutil import get_terminal_size
import sys
from typing import Any, Protocol

from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.tools.estimate import estimate
from flex_plant_sim.arm.parts import MOST_DAMPING
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.report.extended_file import write_extended
from flex_plant_sim.diagnosis.report.figures import all_pictures
from flex_plant_sim.diagnosis.report.html_report import FILE_NAME, Report, write_report
from flex_plant_sim.diagnosis.report.json_answer import answer
from flex_plant_sim.diagnosis.report.latent_pictures import latent_sections
from flex_plant_sim.diagnosis.report.payload_gain import payload_gain, PayloadGain, Weigh
from flex_plant_sim.diagnosis.report.terminal import answer_text
from flex_plant_sim.diagnosis.verdict.completion import complete, Completed
from flex_plant_sim.diagnosis.verdict.locked_part import predicts_worse
from flex_plant_sim.diagnosis.verdict.verdict import diagnose, nominal_base, prepared
from flex_plant_sim.effects import catalogue
from flex_plant_sim.logs.log import Log
from flex_plant_sim.simulation.nominal import (
    has_coriolis,
    model_words,
    nominal_effects,
    WITH_CORIOLIS,
)
from flex_plant_sim.tools import command_line
from flex_plant_sim.tools.log_input import read_logs
from flex_plant_sim.tools.outputs import check_apart, check_folder, check_outputs, results
from msg_config.errors import InputError
from msg_config.parameters import load_parameters
import numpy as np

# Share of a run's time at the end of the search, for the progress bar: on three records of 30 s it
# was 0.72 to 0.86.
SEARCH_SHARE = 0.78


class Progress(Protocol):
    """Shows what is being done, and the share that is done, 0 to 1."""

    def __call__(self, label: str, share: float) -> None:
        """Show the label and the share."""


@dataclass(frozen=True)
class Findings(Completed):
    """All results of a run, before anything is written."""

    payload: tuple[PayloadGain, ...]


def options() -> argparse.ArgumentParser:
    """Return the options of flex_diagnose."""
    parser = command_line.parser('Name what the simulation of a log gets wrong, extend the '
                                 'robot file and measure the gain.')
    command_line.add_log_argument(parser, '+')
    command_line.add_arm_arguments(parser)
    parser.add_argument('--report', default=None, metavar='DIR',
                        help='folder for report.html, made if need be')
    parser.add_argument('--extended', default=None, metavar='FILE',
                        help='write the robot file with its effects, unless it predicts worse')
    command_line.add_json_argument(parser)
    parser.add_argument('--jobs', default=len(os.sched_getaffinity(0)), metavar='N',
                        type=command_line.processes, help='processes')
    parser.add_argument('--true-payload', default=None, type=command_line.mass, metavar='KG',
                        help='what the arm really carries, to measure the payload estimate')
    command_line.add_coriolis_argument(parser)
    parser.add_argument('--exclude', default=[], action='append', metavar='EFFECT',
                        choices=sorted(catalogue()),
                        help='an effect that is not to be considered; may be given again')
    parser.add_argument('--seed', default=0, type=command_line.seed, metavar='N',
                        help='of the bootstrap')
    return parser


def _told(arguments: argparse.Namespace, robot: Robot) -> Robot:
    """Return the robot with the payload that the operator believes in."""
    return command_line.carrying(robot, arguments.payload)


def run(logs: Sequence[Log], robot: Robot, arguments: argparse.Namespace,
        progress: Progress) -> Findings:
    """Diagnose, extend the model and measure the gain; write nothing."""
    records, nominal = prepared(
        [Record.of(log, _told(arguments, robot).payload_mass) for log in logs],
        nominal_base(robot, arguments.model, arguments.modes, not arguments.no_coriolis))
    # A hypothesis may diverge; its fit is dropped, so NumPy's warnings would only confuse.
    with np.errstate(all='ignore'):
        found = diagnose(
            records, nominal, arguments.jobs,
            lambda label, share: progress(label, SEARCH_SHARE * share), arguments.exclude)
    completed = complete(
        found, nominal, arguments.jobs,
        lambda label, share: progress(label, SEARCH_SHARE + (1.0 - SEARCH_SHARE) * share),
        arguments.seed, logs)
    payload = () if arguments.true_payload is None else payload_gain(
        logs, arguments.true_payload, nominal, completed.extended, *default_estimator())
    progress('done', 1.0)
    return Findings(**vars(completed), payload=payload)


def default_estimator() -> tuple[str, Weigh]:
    """Return the default payload estimator's name, and its estimate as a function of a log."""
    name = str(load_parameters()['payload_estimator']['estimator'].default)

    def weigh(log: Log, told: BaseModel) -> tuple[float, float]:
        return estimate(log, make_estimator(name, told.robot, told.model, told.modes)).row(-1)

    return name, weigh


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """Yield a progress bar on stderr; it stays invisible where that is no terminal."""
    try:
        from tqdm import tqdm
    except ImportError:
        yield lambda label, share: None
        return
    # Without tqdm's monitor thread, because workers are forked. A terminal in a container may
    # state no columns, and tqdm then shows nothing.
    single: Any = type('Bar', (tqdm,), {'monitor_interval': 0})
    size = get_terminal_size()
    with single(total=100.0, disable=None, leave=False, file=sys.stderr,
                ncols=size.columns, nrows=size.lines,
                bar_format='{desc} {bar} {percentage:3.0f} % [{elapsed}]') as bar:
        def show(label: str, share: float) -> None:
            bar.set_description_str(f'{label:<28.28}', refresh=False)
            bar.n = max(bar.n, 100.0 * share)
            # A step is told when it begins, however little is done by then.
            bar.refresh()
        yield show


def settings_of(arguments: argparse.Namespace, robot: Robot, logs: Sequence[Log],
                every: int) -> dict[str, Any]:
    """Return the settings of the run, for report and JSON; one sample of `every` was used."""
    described = [f'{log.source}: {len(log)} samples, '
                 f'{log.time[-1] - log.time[0] + log.sample_time:.4g} s at '
                 f'{1.0 / log.sample_time:.4g} Hz{_used(every)}' for log in logs]
    return {
        'logs': described, 'robot': f'{robot.name} ({arguments.robot})',
        'model': arguments.model, 'modes': arguments.modes,
        'payload_told_kg': _told(arguments, robot).payload_mass,
        'coriolis': _coriolis(arguments, robot), 'excluded': list(arguments.exclude),
        'jobs': arguments.jobs, 'seed': arguments.seed, 'version': command_line.package_version()}


def _used(every: int) -> str:
    """Return in words of how many samples one is used; nothing where all are."""
    return f', of which one in {every} is used' if every > 1 else ''


def _coriolis(arguments: argparse.Namespace, robot: Robot) -> bool:
    """Return whether the nominal model has Coriolis forces."""
    return has_coriolis(nominal_effects(robot, arguments.model, not arguments.no_coriolis))


def check_arguments(arguments: argparse.Namespace) -> None:
    """Raise InputError for arguments that would fail only after the work is done."""
    read = [*arguments.log, arguments.robot]
    files = {'--extended': arguments.extended, '--json': arguments.json}
    check_outputs(files, read)
    if arguments.report is not None:
        page = Path(arguments.report)
        check_apart({**{option: Path(path) for option, path in files.items() if path},
                     '--report': page, f'--report ({FILE_NAME})': page / FILE_NAME})
        check_folder('--report', arguments.report, [FILE_NAME], read)
    if arguments.true_payload == 0.0:
        raise InputError('--true-payload: expected a mass > 0 kg, got 0')
    if arguments.model == 'paper_reduced':
        raise InputError('--model: expected assumed_modes or paper, got paper_reduced, which has '
                         'no joint velocities for effects to act on')


def _main(arguments: argparse.Namespace) -> None:
    check_arguments(arguments)
    robot = load_robot(arguments.robot)
    command_line.check_coriolis(arguments, robot)
    logs = read_logs(arguments.log, _told(arguments, robot), arguments.model, arguments.modes,
                     not arguments.no_coriolis)
    with progress_bar() as progress:
        found = run(logs, replace(robot, sample_time=logs[0].sample_time), arguments, progress)
        every = round(found.extended.robot.sample_time / logs[0].sample_time)
        settings = settings_of(arguments, robot, logs, every)
        report = None if arguments.report is None else report_of(found, settings, arguments.jobs)
    with results() as write:
        write(print, 'nominal model: ' + model_words(
            robot.name, arguments.model, arguments.modes, _coriolis(arguments, robot))
              + ', links that bend as they turn' * (arguments.model in WITH_CORIOLIS))
        if every > 1:
            write(print, f'{len(logs[0])} samples{_used(every)}: more tell noise alone')
        write(print, answer_text(found.diagnosis, found.gains, found.payload))
        if arguments.extended:
            # A payload's deviation is one from what was told, not from the file's.
            changed = replace(found.extended.robot, sample_time=robot.sample_time,
                              payload_mass=settings['payload_told_kg'])
            write(_write_extended, arguments, changed, found)
        if arguments.json:
            write(command_line.write_json, arguments.json, answer(
                found.diagnosis, found.gains, found.before, found.after, found.payload,
                settings, found.latent))
        if report is not None:
            write(_write_report, arguments.report, report)


def _write_extended(arguments: argparse.Namespace, robot: Robot, found: Findings) -> None:
    if predicts_worse(found.gains):
        print('extended robot: not written, as ' + (
            f'{arguments.robot} predicts the locked part better as it is'
            if found.diagnosis.moves_parts_alone else
            f'it predicts the locked part worse than {arguments.robot}'))
        return
    write_extended(arguments.extended, arguments.robot, robot, found.extended.effects)
    alone = ', with the parts as estimated and no cause' * found.diagnosis.moves_parts_alone
    print(f'extended robot: {arguments.extended}{alone}')
    if any(link.damping_ratio == MOST_DAMPING for link in robot.links):
        print(f'there a link damps by {MOST_DAMPING:g}, the most a robot file may say; the log '
              'asks for more')


def _write_report(folder: str, report: Report) -> None:
    print(f'report: {write_report(folder, report)}')


def report_of(found: Findings, settings: Mapping[str, Any], jobs: int) -> Report:
    """Return the report of a run with its pictures."""
    texts = {key.replace('_', ' '): _setting_text(value) for key, value in settings.items()}
    return Report(found.diagnosis, found.before, found.after, found.gains, found.payload, texts,
                  all_pictures(found.gains, *found.predictors, jobs),
                  *(latent_sections(found.latent[stage], jobs) if stage in found.latent else ()
                    for stage in ('before', 'after')))


def _setting_text(value: Any) -> str:
    """Return a setting as the report shows it."""
    if isinstance(value, bool):
        return 'yes' if value else 'no'
    return (', '.join(value) or 'none') if isinstance(value, list) else str(value)


def main(argv: Sequence[str] | None = None) -> int:
    """Run flex_diagnose and return its exit code."""
    return command_line.run(lambda: _main(options().parse_args(argv)))


if __name__ == '__main__':
    sys.exit(main())
