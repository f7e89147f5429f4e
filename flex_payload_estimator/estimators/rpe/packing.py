"""All arrays of a filter in one: a compiled call takes one array faster than seven."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
import numpy as np


def pack(x: Array, cov: Array, sensitivity: Array, beta: Array, beta_cov: Array,
         statistics: Array, innovations: Array) -> Array:
    """Return one array of all, in the order of `unpack`."""
    return np.concatenate([part.ravel() for part in (
        x, cov, sensitivity, beta, beta_cov, statistics, innovations)])


def unpack(packed: Array, states: int, parameters: int, channels: int
           ) -> tuple[Array, Array, Array, Array, Array, Array, Array]:
    """
    Return views into a packed array, which may be written.

    Parameters
    ----------
    packed : Array
        Contiguous.
    states, parameters, channels : int
        n, B and m.

    Returns
    -------
    tuple of Array
        x (n,), P (n, n), s (n, B), beta (B,) and V (B, B), see time_update.py; statistics of the
        innovations, (m + 17,), see likelihood.initial_statistics; and the last innovation with
        its standard deviation, (2, m).

    """
    cov = states
    sensitivity = cov + states * states
    beta = sensitivity + states * parameters
    beta_cov = beta + parameters
    statistics = beta_cov + parameters * parameters
    innovations = packed.size - 2 * channels
    return (packed[:cov], packed[cov:sensitivity].reshape(states, states),
            packed[sensitivity:beta].reshape(states, parameters), packed[beta:beta_cov],
            packed[beta_cov:statistics].reshape(parameters, parameters),
            packed[statistics:innovations], packed[innovations:].reshape(2, channels))


# The same, called from compiled code.
unpack_compiled = compiled(unpack)
