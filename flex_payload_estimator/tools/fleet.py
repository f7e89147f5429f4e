"""flex_fleet: diagnose and weigh the logs of many arms; a table with one row per log comes out."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import closing, nullcontext
from dataclasses import replace
import errno
from hashlib import sha256
import os
from pathlib import Path
import sys
from typing import Any

from flex_payload_estimator.fleet.folders import arm_of, logs_below, robot_of
from flex_payload_estimator.fleet.journal import Journal
from flex_payload_estimator.fleet.log_task import LogTask, Row
from flex_payload_estimator.fleet.schedule import cluster, completed_rows
from flex_payload_estimator.fleet.table import (
    check_tables,
    CSV,
    PAGE,
    PARQUET,
    write_csv,
    write_page,
    write_parquet,
)
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.tools import command_line
from flex_plant_sim.tools.outputs import check_folder
from msg_config.errors import InputError, printable


def options() -> argparse.ArgumentParser:
    """Return the options of flex_fleet."""
    parser = command_line.parser(
        'Diagnose and weigh every log below folders: one row a log, a page for each. A folder '
        'with a robot.yaml holds the logs of that robot. Called again with the same --out, it '
        'goes on where it was.')
    parser.add_argument('folder', metavar='FOLDER', nargs='+', help='folder of logs')
    parser.add_argument('--out', required=True, metavar='DIR',
                        help='folder for the table and the pages; new, empty or an earlier one')
    parser.add_argument('--robot', default='reference', metavar='NAME|FILE',
                        help='robot of logs that have no robot.yaml')
    parser.add_argument('--payload', default=None, type=command_line.mass, metavar='KG',
                        help="payload mass; the robot file's if not given")
    parser.add_argument('--workers', default=None, metavar='N', type=command_line.processes,
                        help='processes on this machine; one a core if not given')
    parser.add_argument('--scheduler', default=None, metavar='ADDRESS',
                        help='Dask scheduler to use instead, as tcp://host:8786; its workers '
                             'see the same folders')
    parser.add_argument('--timeout', default=600, type=command_line.count, metavar='S',
                        help='a log that takes longer is given up')
    return parser


def tasks_of(arguments: argparse.Namespace, out: Path) -> list[LogTask]:
    """Return a task for every log below the folders."""
    load_robot(arguments.robot)
    logs = logs_below(arguments.folder, out)
    homes: dict[str, set[Path]] = {}
    for folder, log in logs:
        homes.setdefault(arm_of(folder, log), set()).add(log.parent.absolute())
    found = []
    for folder, log in logs:
        arm = arm_of(folder, log)
        if len(homes[arm]) > 1:
            # Two arms whose folders bear one name.
            arm = log.parent.absolute().as_posix()
        task = LogTask(arm, str(log.absolute()), robot_of(folder, log, arguments.robot), '',
                       arguments.payload, float(arguments.timeout))
        # By log and settings: a page keeps its place when further logs join.
        page = out / 'pages' / sha256(os.fsencode(task.settings)).hexdigest()[:12]
        found.append(replace(task, report=str(page.absolute())))
    return found


def run(tasks: Sequence[LogTask], journal: Journal, scheduler: str | None, workers: int
        ) -> list[Row]:
    """Return the rows of all tasks; tasks whose row the journal has are not done again."""
    known = journal.rows()
    left = [task for task in tasks if task.key not in known]
    with _progress(len(tasks), len(tasks) - len(left)) as bar:
        if left:
            with cluster(scheduler, workers) as client:
                for task, row in completed_rows(client, left):
                    journal.add(task, row)
                    known[task.key] = row
                    bar.update()
    return [_printable_row(known[task.key]) for task in tasks]


def _printable_row(row: Row) -> Row:
    """Return a row whose texts a table can hold, whatever bytes a file name has."""
    texts: dict[str, Any] = {name: printable(value) for name, value in vars(row).items()
                             if isinstance(value, str)}
    return replace(row, **texts)


def _progress(total: int, done: int) -> Any:
    """Return a progress bar over the logs, or one that shows nothing where tqdm is missing."""
    try:
        from tqdm import tqdm
    except ImportError:
        return nullcontext(_Silent())
    return tqdm(total=total, initial=done, disable=None, unit='log', file=sys.stderr)


class _Silent:
    """Stands for a progress bar where tqdm is missing."""

    def update(self) -> None:
        """Show nothing."""


def _main(arguments: argparse.Namespace) -> None:
    out = Path(arguments.out)
    if printable(arguments.out) != arguments.out:
        raise InputError(f'--out: {arguments.out}: expected a name in UTF-8, without controls')
    if arguments.scheduler is not None and arguments.workers is not None:
        raise InputError('--workers: expected none with --scheduler, which has workers of its own')
    check_folder('--out', out, (), nested=True)
    tasks = tasks_of(arguments, out)
    with closing(Journal(out)) as journal:
        check_tables(journal)
        rows = run(tasks, journal, arguments.scheduler,
                   arguments.workers or len(os.sched_getaffinity(0)))
        write_csv(journal, rows)
        written = [CSV, *([PARQUET] if write_parquet(journal, rows) else []),
                   *([PAGE] if write_page(journal, rows) else [])]
    failed = sum(bool(row.error) for row in rows)
    print(f'{len(rows)} logs of {len({row.arm for row in rows})} arms, {failed} with errors: '
          + ', '.join(str(out / name) for name in written))
    if failed == len(rows):
        # What another start may do is the machine's fault, not that of the logs.
        passing = BlockingIOError(errno.EAGAIN, '') if all(row.again for row in rows) else None
        raise InputError(f'{rows[0].log}: {rows[0].error}') from passing


def main(argv: Sequence[str] | None = None) -> int:
    """Run flex_fleet and return its exit code."""
    return command_line.run(lambda: _main(options().parse_args(argv)))


if __name__ == '__main__':
    sys.exit(main())
