"""
The fleet's table: one row per log, and since which log an arm gives the same result.

It is written as CSV, Parquet and HTML into the output folder that the journal has checked. The
journal knows what was written: a table that was edited since is not replaced.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import csv
from dataclasses import asdict
from importlib import resources
import os
from pathlib import Path
from typing import Any

from flex_payload_estimator.fleet.journal import Journal
from flex_payload_estimator.fleet.log_task import Row
from flex_plant_sim.atomic_file import check_replaceable, whole_file

CSV, PARQUET, PAGE = 'fleet.csv', 'fleet.parquet', 'fleet.html'
# First characters by which a spreadsheet takes a cell for a formula.
FORMULA = ('=', '+', '-', '@')


def since(rows: Sequence[Row]) -> list[str]:
    """
    Return, for each row, the first log since which its arm has had the same verdict and causes.

    Rows of an arm are in the order of their logs' names. A log that failed has no such log, and
    does not interrupt the series.
    """
    first: dict[str, tuple[Any, str]] = {}
    found = []
    for row in rows:
        result = (row.verdict, frozenset(row.causes))
        if row.verdict and first.get(row.arm, (None, ''))[0] != result:
            first[row.arm] = (result, row.log)
        found.append(first[row.arm][1] if row.verdict else '')
    return found


def records(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the rows as the table's columns."""
    return [{**asdict(row), 'causes': ' '.join(row.causes), 'seconds': round(row.seconds, 2),
             'since': start} for row, start in zip(rows, since(rows))]


def check_tables(journal: Journal) -> None:
    """
    Check that nobody edited the tables of an earlier run.

    Raises
    ------
    InputError
        Names the first that is no more as it was written.

    """
    for name in (CSV, PARQUET, PAGE):
        check_replaceable(journal.folder / name, known=journal.wrote(name))


@contextmanager
def _table(journal: Journal, name: str) -> Iterator[Path]:
    """Yield a temporary path for a table, which appears whole or not at all."""
    with whole_file(journal.folder / name, known=journal.wrote(name)) as temporary:
        yield temporary
        # Before it appears: a kill in between must not make the table a stranger's.
        journal.note(temporary)


def write_csv(journal: Journal, rows: Sequence[Row]) -> None:
    """Write the table as CSV, whole or not at all; a spreadsheet takes no cell for a formula."""
    table = records(rows)
    with _table(journal, CSV) as temporary, \
            temporary.open('w', newline='', encoding='utf-8') as file:
        writer = csv.DictWriter(file, list(table[0]))
        writer.writeheader()
        writer.writerows({key: _cell(value) for key, value in row.items()} for row in table)


def _cell(value: Any) -> Any:
    formula = isinstance(value, str) and value.startswith(FORMULA)
    return f"'{value}" if formula else value


def write_parquet(journal: Journal, rows: Sequence[Row]) -> bool:
    """Write the table as Parquet where pyarrow is installed; return whether it is."""
    try:
        from pyarrow import Table
        from pyarrow.parquet import write_table
    except ImportError:
        return False
    with _table(journal, PARQUET) as temporary:
        write_table(Table.from_pylist(records(rows)), temporary)
    return True


def write_page(journal: Journal, rows: Sequence[Row]) -> bool:
    """Write the table as a page with links to the reports; return whether Jinja is installed."""
    try:
        from jinja2 import Environment
    except ImportError:
        return False
    template = (resources.files('flex_payload_estimator') / 'fleet' / 'fleet.html').read_text(
        encoding='utf-8')
    table = records(rows)
    for row in table:
        row['link'] = os.path.relpath(row['report'], journal.folder) if row['report'] else ''
    counts: dict[str, int] = {}
    for row in table:
        name = row['verdict'] or 'failed'
        counts[name] = counts.get(name, 0) + 1
    with _table(journal, PAGE) as temporary:
        temporary.write_text(Environment(autoescape=True).from_string(template).render(
            rows=table, counts=counts, arms=len({row.arm for row in rows})), encoding='utf-8')
    return True
