"""Rows whose readings are all those of the row before: a writer was faster than its source."""

from __future__ import annotations

from collections.abc import Callable

from flex_plant_sim.arm.second_order import Array
import numpy as np

# Rows that repeat by chance in one log of a thousand: more are stale.
CHANCE = 1e-3


def stale_note(readings: Array, name: Callable[[int], str]) -> str:
    """
    Return a note if rows of readings, (N, m), repeat the row before; a row's name for the first.

    Else '', and where that may be chance: with p_k the share of rows in which channel k changes,
    all stay the same in N prod(1 - p_k) rows. Coarse readings of an arm at rest do.
    """
    changed = np.diff(readings, axis=0) != 0.0
    stale = np.flatnonzero(~changed.any(axis=1)) + 1
    chance = len(changed) * np.prod(1.0 - changed.mean(axis=0))
    return '' if not stale.size or chance > CHANCE else (
        f'{len(stale)} of {len(readings)} rows have all readings of the row before, first '
        f'{name(int(stale[0]))}: written faster than measured, or lost? leave them out')
