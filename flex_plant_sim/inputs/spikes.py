"""Single samples that stand out from their neighbours, as no motion makes them."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
import numpy as np
from numpy.typing import NDArray

# A cubic through two neighbours on either side, at the middle.
CUBIC = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0
# Beyond the channel's own roughness; ten standard deviations where that is noise.
STANDS_OUT = 10.0
# Of the roughness around a spike that goes with it; a step or a kink leaves more.
EXPLAINED = 0.97
# Of the channel's range; a smaller spike misleads nobody.
VISIBLE = 0.02


def spikes(values: Array) -> NDArray[np.int64]:
    """
    Return the rows and columns of single samples that stand out, (K, 2).

    A sample that is wrong alone leaves (1, -4, 6, -4, 1) / 6 of its error in the differences
    from a cubic through the neighbours; what a sample does with its neighbours leaves another
    pattern.

    Parameters
    ----------
    values : Array
        Evenly sampled, (N, n).

    """
    if len(values) < 16:
        return np.zeros((0, 2), dtype=np.int64)
    rough = np.stack([np.convolve(column, CUBIC, 'same') for column in values.T], axis=1)
    rough[:2] = rough[-2:] = 0.0
    usual = np.median(np.abs(rough), axis=0) / 0.6745
    error = np.stack([np.convolve(column, CUBIC, 'same') for column in rough.T], axis=1) \
        / float(CUBIC @ CUBIC)
    around = np.stack([np.convolve(column**2, np.ones(5), 'same') for column in rough.T], axis=1)
    found = (np.abs(error) > STANDS_OUT * usual) \
        & (np.abs(error) > VISIBLE * np.ptp(values, axis=0)) \
        & (error**2 * float(CUBIC @ CUBIC) > EXPLAINED * around)
    return np.argwhere(found).astype(np.int64)
