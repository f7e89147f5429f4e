"""Reads the table in a CSV file and detects its encoding, separator and decimal sign."""

from __future__ import annotations

import codecs
from collections.abc import Sequence
import csv
from dataclasses import dataclass
from pathlib import Path
import re

from flex_plant_sim.arm.second_order import Array
from msg_config.errors import InputError
import numpy as np

# Largest file, bytes: nine minutes at 1 kHz in nine digits (140 bytes per row). A longer log is
# to be a bag, or several files.
MAX_BYTES = 80_000_000
# Longest line, characters: 4000 numbers, more channels than a recorder has.
MAX_LINE = 60_000
UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
SEPARATORS = (',', ';', '\t')
# A quoted number whose comma separates no thousands, as in "0,01"; a decimal point.
DECIMAL_COMMA = re.compile(r'"[-+]?(?:0,|\d+,(?!\d{3}[",]))\d')
DECIMAL_POINT = re.compile(r'\.\d')
# A writer that pads exponents to two digits always does so; a single digit is then what a cut
# line leaves of two.
PADDED = re.compile(r'[eE][-+]0\d')
CUT = re.compile(r'(?<=[\d.])[eE](?:[-+]?\d?)(?=[,;\t"\s]|$)')


@dataclass(frozen=True)
class Table:
    """
    The header of a CSV file and the lines below it.

    Attributes
    ----------
    path : Path
    header : list of str
    lines : list of str
        Lines without empty ones and comments.
    numbers_of_lines : list of int
        Their line numbers in the file, from 1.
    separator : str
    decimal_comma : bool
    notes : tuple of str
        Notes for the user on how the file was read.

    """

    path: Path
    header: list[str]
    lines: list[str]
    numbers_of_lines: list[int]
    separator: str
    decimal_comma: bool
    notes: tuple[str, ...]

    def numbers(self, names: Sequence[str]) -> Array:
        """
        Return columns by name, (N, len(names)); an empty cell is NaN.

        Raises
        ------
        InputError
            A line has too many or too few columns, or text in place of a number; names the line.

        """
        lines = self.lines
        if not lines:
            raise InputError(f'{self.path}: expected at least 2 samples, got 0')
        # In quotes where commas separate.
        quoted = self.decimal_comma and self.separator == ','
        if self.decimal_comma and not quoted:
            lines = [line.replace(',', '.') for line in lines]
        columns = [self.header.index(name) for name in names]
        self._check_exponents(lines, columns)
        # Text may hold the separator in quotes, where no number is read.
        instead = '.' if quoted else ' '
        lines = [line if '"' not in line else self.separator.join(
            cell.replace(self.separator, instead) for cell in self._cells(line)) for line in lines]
        commas = len(self.header) - 1
        if all(line.count(self.separator) == commas for line in lines):
            for read in (lambda: lines, lambda: self._filled(lines)):
                try:
                    return np.loadtxt(read(), delimiter=self.separator, ndmin=2, comments=None,
                                      quotechar='"', usecols=columns)
                except ValueError:
                    pass
        raise InputError(f'{self.path}: {self._first_error(lines, columns)}')

    def _filled(self, lines: list[str]) -> list[str]:
        """Return lines with nan in empty cells, which is how pandas writes it."""
        return [self.separator.join(cell if cell.strip() else 'nan'
                                    for cell in line.split(self.separator)) for line in lines]

    def _cells(self, line: str) -> list[str]:
        """Return the cells of a line, without their quotes."""
        return next(csv.reader([line], delimiter=self.separator)) if '"' in line \
            else line.split(self.separator)

    def _check_exponents(self, lines: list[str], columns: list[int]) -> None:
        """Raise InputError if a number was cut in its exponent: 1e-0 may have been 1e-05."""
        if not any(map(PADDED.search, lines)):
            return
        for number, line in zip(self.numbers_of_lines, lines):
            if not CUT.search(line):
                continue
            row = self._cells(line)
            cut = [found for k in columns if k < len(row) and (found := CUT.search(row[k]))]
            if cut:
                raise InputError(f'{self.path}: line {number}: expected exponents of two digits '
                                 f'as elsewhere, got {cut[0].group()!r}: a number was cut')

    def _first_error(self, lines: list[str], columns: list[int]) -> str:
        """Return what is wrong in the first line that does not have one number per column."""
        for number, line, written in zip(self.numbers_of_lines, lines, self.lines):
            row = self._cells(line)
            if len(row) != len(self.header):
                why = ' (decimal commas? separate by semicolons)' \
                    if self.separator == ',' and len(row) > 1.5 * len(self.header) else ''
                why = ' (a quote is left open)' if _left_open(written) else why
                return (f'line {number}: expected {len(self.header)} columns, got {len(row)}'
                        f'{why}')
            for k in columns:
                if row[k].strip() and not _is_number(row[k]):
                    return (f'line {number}: {self.header[k]}: expected a number, '
                            f'got {self._cells(written)[k][:40]!r}')
        return f'expected {len(self.header)} numbers a line'


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    # What Python reads beside NumPy: 1_000 and other alphabets' digits.
    return text.isascii() and '_' not in text


def read_table(path: Path) -> Table:
    """
    Return the table in a CSV file: UTF-8 or UTF-16, separated by comma, semicolon or tab.

    Numbers may have decimal commas, in quotes where commas separate the columns. Lines that start
    with # are comments. A last line without a line end may be cut, and is left out.

    Raises
    ------
    InputError
        The file is no such table; names the line and the likely cause.

    """
    text = _text(path)
    lines = [(k, line) for k, line in enumerate(text.splitlines(), start=1)
             if line.strip() and not line.startswith('#')]
    if not lines:
        raise InputError(f'{path}: expected a header row, the file is empty')
    longest = max(lines, key=lambda item: len(item[1]))
    if len(longest[1]) > MAX_LINE:
        raise InputError(f'{path}: line {longest[0]}: expected at most {MAX_LINE} characters, '
                         f'got {len(longest[1])}')
    separator = max(SEPARATORS, key=lines[0][1].count)
    header = _header(path, *lines[0], separator)
    data, notes = lines[1:], []
    if len(data) > 2 and not text.endswith(('\n', '\r')):
        notes.append(f'line {data[-1][0]}: left out: its end is missing, and its last number may '
                     'be cut')
        data = data[:-1]
    notes += [] if separator == ',' else [f'columns separated by {separator!r}']
    comma = _has_decimal_commas([line for _, line in data], separator)
    return Table(path, header, [line for _, line in data], [k for k, _ in data], separator, comma,
                 tuple([*notes, 'decimal commas read as points'] if comma else notes))


def _left_open(line: str) -> bool:
    """Return whether a quote has no partner: it takes the rest of the line for one cell."""
    return line.count('"') % 2 == 1


def _has_decimal_commas(lines: Sequence[str], separator: str) -> bool:
    """Return whether commas are decimal: where they separate columns, only beside no point."""
    if separator != ',':
        return any(',' in line for line in lines)
    return (any('"' in line and DECIMAL_COMMA.search(line) for line in lines)
            and not any(map(DECIMAL_POINT.search, lines)))


def _header(path: Path, number: int, line: str, separator: str) -> list[str]:
    try:
        header = [name.strip() for name in next(csv.reader([line], delimiter=separator), [])]
    except csv.Error as error:
        raise InputError(f'{path}: line {number}: expected a header row, got: {error}') from None
    if _left_open(line) and separator in header[-1]:
        raise InputError(f'{path}: line {number}: expected quotes in pairs, got one left open at '
                         f'{header[-1][:60]!r}')
    if all(re.fullmatch(r'[-+\d.eE]*', name) for name in header):
        raise InputError(f'{path}: expected a header row that names the columns and is no '
                         f'comment (#), got {line[:60]!r}')
    return header


def _text(path: Path) -> str:
    try:
        with open(path, 'rb') as file:
            raw = file.read(MAX_BYTES + 1)
        if len(raw) > MAX_BYTES:
            raise InputError(f'{path}: expected at most {MAX_BYTES / 1e6:g} MB; cut the log, or '
                             'write it as a bag')
        text = raw.decode('utf-16' if raw.startswith(UTF_16) else 'utf-8-sig')
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f'{path}: expected a readable text file, got: {error}') from None
    if '\0' in text:
        raise InputError(f'{path}: expected a readable text file, got a zero byte')
    return text
