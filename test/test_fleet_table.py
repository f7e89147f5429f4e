"""The table of flex_fleet: since when an arm answers alike, and what becomes of an earlier one."""

from __future__ import annotations

import csv
from pathlib import Path

from flex_payload_estimator.fleet.journal import Journal
from flex_payload_estimator.fleet.log_task import Row
from flex_payload_estimator.fleet.table import check_tables, CSV, since, write_csv
from msg_config.errors import InputError
import pytest


def rows_of(folder: Path) -> list[dict[str, str]]:
    """Return the rows of a fleet's table."""
    with (folder / CSV).open(newline='') as file:
        return list(csv.DictReader(file))


def test_since_when_an_arm_answers_as_it_does() -> None:
    rows = [Row('a', '1', 'nothing_wrong'), Row('b', '1', 'nothing_wrong'),
            Row('a', '2', 'cause', causes=('x:arm', 'y:arm')), Row('a', '3', error='bad'),
            Row('a', '4', 'cause', causes=('y:arm', 'x:arm')), Row('a', '5', 'nothing_wrong')]
    assert since(rows) == ['1', '1', '2', '', '2', '5']


def test_no_cell_is_a_formula(tmp_path: Path) -> None:
    write_csv(Journal(tmp_path / 'out'), [Row('=cmd()', 'log', error='-1')])
    row, = rows_of(tmp_path / 'out')
    assert row['arm'] == "'=cmd()" and row['error'] == "'-1"


def test_a_table_is_replaced_unless_it_was_edited(tmp_path: Path) -> None:
    journal, table = Journal(tmp_path / 'out'), tmp_path / 'out' / 'fleet.csv'
    for log in ('1', '2'):
        write_csv(journal, [Row('a', log)])
        check_tables(journal)
        assert [row['log'] for row in rows_of(tmp_path / 'out')] == [log]
    with table.open('a') as file:
        file.write('my own note\n')
    with pytest.raises(InputError, match='fleet.csv: expected a new place'):
        check_tables(journal)
    with pytest.raises(InputError, match='fleet.csv: expected a new place'):
        write_csv(journal, [Row('a', '3')])
    assert table.read_text().endswith('my own note\n') and not journal.rows()
