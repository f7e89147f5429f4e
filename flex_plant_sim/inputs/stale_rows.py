"""Rows whose readings are all those of the row before: a writer was faster than its source."""

from __future__ import annotations

from collections.abc import Callable

from flex_plant_sim.arm.second_order import Array
import numpy as np
from scipy.ndimage import uniform_filter1d

# Rows that repeat by chance in one log of a thousand: more are stale.
CHANCE = 1e-3
# Rows over which a channel's share of changes is taken: few enough for a rest of half a second to
# show at 100 Hz, and so many that a stale row among them weighs little.
NEARBY = 51


def stale_note(readings: Array, name: Callable[[int], str]) -> str:
    """
    Return a note if rows of readings, (N, m), repeat the row before; a row's name for the first.

    Else ''. With p_k the share of rows nearby in which channel k changes, all stay the same by
    chance with prod(1 - p_k), as coarse readings of an arm at rest do: such rows are left out.
    """
    changed = np.diff(readings, axis=0) != 0.0
    nearby = uniform_filter1d(changed.astype(float), NEARBY, axis=0, mode='nearest')
    chance = np.prod(1.0 - nearby, axis=1)
    stale = np.flatnonzero(~changed.any(axis=1) & (len(changed) * chance < CHANCE)) + 1
    return '' if not stale.size else (
        f'{len(stale)} of {len(readings)} rows have all readings of the row before, first '
        f'{name(int(stale[0]))}: written faster than measured, or lost? leave them out')
