"""Whether the first row of a record is a reading: no row before it tells, those after it do."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
import numpy as np

# Ratio of the first change of a channel's rate to the largest of all later ones from which its
# first row is off: a second row that is off makes the first change twice the next.
LEAPS = 3.0
# Fewest rows: where all changes are alike, one in so many records has its largest first.
FEWEST = 100


def off_channel(time: Array, output: Array) -> int | None:
    """
    Return the channel whose first row is no reading; None if there is none.

    A driver that starts at zero, or keeps its last value, gives a first row that the next ones
    deny. The rate of a channel then changes once as it never does again, whatever the arm does. An
    arm that starts from rest with a leap of its command may do so, too, but is slower in the first
    interval than in the second.

    Parameters
    ----------
    time : Array
        s, increasing, (N,).
    output : Array
        (N, m).

    """
    if len(time) < FEWEST:
        return None
    rate = np.diff(output, axis=0) / np.diff(time)[:, None]
    change = np.abs(np.diff(rate, axis=0))
    leaps = ((change[0] > LEAPS * np.fmax.reduce(change[1:], axis=0))
             & (np.abs(rate[0]) > np.abs(rate[1])))
    return int(np.argmax(leaps)) if leaps.any() else None
