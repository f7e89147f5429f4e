"""
The fleet's table: one row a log, and since when an arm answers as it does now.

It stands in a folder that the journal has found to be the fleet's.
"""

from __future__ import annotations

from collections.abc import Sequence
import csv
from dataclasses import asdict
from importlib import resources
import os
from pathlib import Path
from typing import Any

from flex_payload_estimator.fleet.log_task import Row
from flex_plant_sim.atomic_file import whole_file

FORMULA = ('=', '+', '-', '@')


def since(rows: Sequence[Row]) -> list[str]:
    """
    Return for each row the arm's first log with the same verdict and causes without a break.

    Rows of an arm are in the order of their logs' names; a log that failed breaks nothing.
    """
    first: dict[str, tuple[Any, str]] = {}
    found = []
    for row in rows:
        said = (row.verdict, frozenset(row.causes))
        if row.verdict and first.get(row.arm, (None, ''))[0] != said:
            first[row.arm] = (said, row.log)
        found.append(first[row.arm][1] if row.verdict else '')
    return found


def records(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the rows as the table's columns."""
    return [{**asdict(row), 'causes': ' '.join(row.causes), 'seconds': round(row.seconds, 2),
             'since': start} for row, start in zip(rows, since(rows))]


def write_csv(path: Path, rows: Sequence[Row]) -> None:
    """Write the table as CSV, whole or not at all; no cell is a formula to a spreadsheet."""
    table = records(rows)
    with whole_file(path, known=True) as temporary, \
            temporary.open('w', newline='', encoding='utf-8') as file:
        writer = csv.DictWriter(file, list(table[0]))
        writer.writeheader()
        writer.writerows({key: _cell(value) for key, value in row.items()} for row in table)


def _cell(value: Any) -> Any:
    formula = isinstance(value, str) and value.startswith(FORMULA)
    return f"'{value}" if formula else value


def write_parquet(path: Path, rows: Sequence[Row]) -> bool:
    """Write the table as Parquet where pyarrow is installed; tell whether it is."""
    try:
        from pyarrow import Table
        from pyarrow.parquet import write_table
    except ImportError:
        return False
    with whole_file(path, known=True) as temporary:
        write_table(Table.from_pylist(records(rows)), temporary)
    return True


def write_page(path: Path, rows: Sequence[Row]) -> bool:
    """Write the table as a page that links every log's report; tell whether Jinja is there."""
    try:
        from jinja2 import Environment
    except ImportError:
        return False
    template = (resources.files('flex_payload_estimator') / 'fleet' / 'fleet.html').read_text(
        encoding='utf-8')
    table = records(rows)
    for row in table:
        row['link'] = os.path.relpath(row['report'], path.parent) if row['report'] else ''
    counts: dict[str, int] = {}
    for row in table:
        name = row['verdict'] or 'failed'
        counts[name] = counts.get(name, 0) + 1
    with whole_file(path, known=True) as temporary:
        temporary.write_text(Environment(autoescape=True).from_string(template).render(
            rows=table, counts=counts, arms=len({row.arm for row in rows})), encoding='utf-8')
    return True
