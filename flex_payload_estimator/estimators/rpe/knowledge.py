"""All that a filter learns in one array: a compiled call takes one faster than seven."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
import numpy as np


def joined(x: Array, cov: Array, sens: Array, beta: Array, spread: Array, record: Array,
           reading: Array) -> Array:
    """Return all in one array, in the order of `parted`."""
    return np.concatenate([part.ravel() for part in (x, cov, sens, beta, spread, record,
                                                     reading)])


def parted(known: Array, states: int, size: int, channels: int
           ) -> tuple[Array, Array, Array, Array, Array, Array, Array]:
    """
    Return what lies in `known`, each as a part of it that may be written.

    x (n,), P (n, n), s (n, B), beta (B,), V (B, B), see kernel.py; record and reading (2, m),
    see evidence.weigh and onward.learnt.

    Parameters
    ----------
    known : Array
        Contiguous.
    states, size, channels : int
        n, B and m.

    """
    cov = states
    sens = cov + states * states
    beta = sens + states * size
    spread = beta + size
    record = spread + size * size
    reading = known.size - 2 * channels
    return (known[:cov], known[cov:sens].reshape(states, states),
            known[sens:beta].reshape(states, size), known[beta:spread],
            known[spread:record].reshape(size, size), known[record:reading],
            known[reading:].reshape(2, channels))


# The same, called from compiled code.
parts_of = compiled(parted)
