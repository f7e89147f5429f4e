"""Disturbances of a record between arm and file that leave it readable, as changes of a table."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

# A table, (N, C): time, s, and the samples and commands at it, in any units.
Table = np.ndarray
Disturbance = Callable[[np.random.Generator, Table], Table]


def _some(rng: np.random.Generator, table: Table) -> int:
    """Return a column that is not time."""
    return int(rng.integers(1, table.shape[1]))


def _stretch(rng: np.random.Generator, table: Table) -> slice:
    start = int(rng.integers(0, len(table) - 2))
    return slice(start, int(rng.integers(start + 1, len(table))))


def stuck(rng: np.random.Generator, table: Table) -> Table:
    """Let a channel keep its value, for a while or to the end."""
    rows, k = _stretch(rng, table), _some(rng, table)
    table[rows, k] = table[rows.start, k]
    return table


def dead(rng: np.random.Generator, table: Table) -> Table:
    """Let a channel be zero."""
    table[:, _some(rng, table)] = 0.0
    return table


def scaled(rng: np.random.Generator, table: Table) -> Table:
    """Scale a channel, or turn its sign."""
    table[:, _some(rng, table)] *= rng.choice([-1.0, 0.1, 0.5, 1.2, 2.0, 10.0, 180.0 / np.pi])
    return table


def exchanged(rng: np.random.Generator, table: Table) -> Table:
    """Exchange two channels."""
    a, b = _some(rng, table), _some(rng, table)
    table[:, [a, b]] = table[:, [b, a]]
    return table


def shifted(rng: np.random.Generator, table: Table) -> Table:
    """Let a channel come late or early by up to half a second."""
    k = _some(rng, table)
    table[:, k] = np.roll(table[:, k], int(rng.integers(-50, 50)))
    return table


def noisy(rng: np.random.Generator, table: Table) -> Table:
    """Add noise of up to its own size to a channel."""
    k = _some(rng, table)
    size = 10.0**rng.uniform(-3.0, 0.0) * np.ptp(table[:, k])
    table[:, k] += size * rng.standard_normal(len(table))
    return table


def spikes(rng: np.random.Generator, table: Table) -> Table:
    """Add a few single errors."""
    k, count = _some(rng, table), int(rng.integers(1, 20))
    size = 10.0**rng.uniform(0.0, 4.0) * (np.ptp(table[:, k]) or 1.0)
    table[rng.integers(0, len(table), count), k] += size * rng.standard_normal(count)
    return table


def quantised(rng: np.random.Generator, table: Table) -> Table:
    """Quantise a channel to four to a hundred steps."""
    k = _some(rng, table)
    step = (np.ptp(table[:, k]) or 1.0) / rng.choice([4, 20, 100])
    table[:, k] = step * np.round(table[:, k] / step)
    return table


def clipped(rng: np.random.Generator, table: Table) -> Table:
    """Clip a channel at a share of its range."""
    k = _some(rng, table)
    largest = rng.uniform(0.1, 0.9) * np.abs(table[:, k]).max()
    table[:, k] = np.clip(table[:, k], -largest, largest)
    return table


def drifting(rng: np.random.Generator, table: Table) -> Table:
    """Add a drift or a step."""
    k = _some(rng, table)
    law = np.linspace(0.0, 1.0, len(table))
    if rng.random() < 0.5:
        law = (law > rng.random()).astype(float)
    table[:, k] += rng.normal() * np.ptp(table[:, k]) * law
    return table


def lost(rng: np.random.Generator, table: Table) -> Table:
    """Lose rows here and there, or a stretch."""
    if rng.random() < 0.5:
        return table[rng.random(len(table)) > rng.uniform(0.0, 0.3)]
    rows = _stretch(rng, table)
    kept: Table = np.delete(table, slice(rows.start, min(rows.stop, rows.start + 200)), axis=0)
    return kept


def jittered(rng: np.random.Generator, table: Table) -> Table:
    """Stamp the rows unevenly."""
    interval = float(np.median(np.diff(table[:, 0])))
    table[:, 0] += rng.uniform(0.0, 0.6) * interval * rng.uniform(-0.5, 0.5, len(table))
    return table


def another_rate(rng: np.random.Generator, table: Table) -> Table:
    """Let the clock run at another rate, or keep every second row."""
    if rng.random() < 0.5:
        return table[::2]
    table[:, 0] *= rng.choice([0.5, 0.9, 1.1, 2.0])
    return table


def resting(rng: np.random.Generator, table: Table) -> Table:
    """Let the record go on at rest."""
    rows = slice(int(rng.integers(1, len(table))), None)
    table[rows, 1:] = table[rows.start, 1:]
    return table


def short(rng: np.random.Generator, table: Table) -> Table:
    """Keep a part."""
    return table[_stretch(rng, table)]


def repeated(rng: np.random.Generator, table: Table) -> Table:
    """Write a part of the values again over later ones."""
    rows = _stretch(rng, table)
    other = np.roll(table[:, 1:], int(rng.integers(1, len(table))), axis=0)
    table[rows, 1:] = other[rows]
    return table


def locked(rng: np.random.Generator, table: Table) -> Table:
    """Hold a joint, or let it move for a while alone; its command may go on."""
    k = int(rng.integers(2))
    rows = slice(None) if rng.random() < 0.5 else _stretch(rng, table)
    for column in (1 + k, 3 + k)[int(rng.integers(2)):]:
        table[rows, column] = table[rows, column][0]
    return table


def blind(rng: np.random.Generator, table: Table) -> Table:
    """Let all gauges of a link keep their values."""
    gauges = np.array_split(np.arange(5, table.shape[1]), 2)[int(rng.integers(2))]
    table[:, gauges] = table[0, gauges]
    return table


def not_a_number(rng: np.random.Generator, table: Table) -> Table:
    """Set a channel to NaN here and there, or for up to a second."""
    k = _some(rng, table)
    if rng.random() < 0.5:
        table[rng.random(len(table)) < rng.uniform(0.0, 0.05), k] = np.nan
    else:
        rows = _stretch(rng, table)
        table[rows.start:min(rows.stop, rows.start + 100), k] = np.nan
    return table


# They expect the columns time, two commands, two angles, and the gauges.
DISTURBANCES: tuple[Disturbance, ...] = (
    stuck, dead, scaled, exchanged, shifted, noisy, spikes, quantised, clipped, drifting, lost,
    jittered, another_rate, resting, short, repeated, locked, blind, not_a_number)
